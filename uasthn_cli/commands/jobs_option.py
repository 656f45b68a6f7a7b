"""How many frames are looked at at once: ``--jobs``, of the commands that geo-tag."""

from typing import Any, Final

import click

from uasthn_cli.commands.sections import section_option


class JobsType(click.ParamType["int | None"]):
    """A whole number from 1, or ``auto``."""

    name = "N|auto"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> int | None:
        """Return the number, None for ``auto``."""
        if value is None or str(value) == "auto":
            return None
        if not (str(value).isdecimal() and 1 <= int(value) <= _MOST):
            self.fail(f"{value!r} is neither auto nor a number from 1 to {_MOST}", param, ctx)
        return int(value)


_MOST: Final = 256

jobs_option: Final = section_option("Machine")(
    "--jobs",
    type=JobsType(),
    metavar="N|auto",
    help="Frames that xcorr and ncc look at at once, each on one core; results are the same bytes"
    " for any number.  [default: auto, as many as there are cores, by affinity and quota]",
)
