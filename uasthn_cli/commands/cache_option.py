"""Where features of maps are kept: ``--cache``, of the commands that geo-tag."""

from pathlib import Path
from typing import Any, Final

import click

from uasthn_cli.commands.options import output_option
from uasthn_cli.config import MAX_CACHE_BYTES


class CacheDirType(click.ParamType["Path | None"]):
    """A folder, or ``none``."""

    name = "DIR|none"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Path | None:
        """Return the folder, None for ``none``."""
        if str(value) == "none":
            return None
        path = Path(value).expanduser()
        if path.exists() and not path.is_dir():
            self.fail(f"{path} is a file; give a folder, or none", param, ctx)
        return path.absolute()


def _default_cache_dir() -> Path | None:
    """Return the user's own folder; None where they have no home."""
    from uasthn_cli.mapping.feature_store import default_cache_dir

    try:
        return default_cache_dir()
    except RuntimeError:
        return None


cache_option: Final = output_option(
    "--cache",
    "cache_dir",
    type=CacheDirType(),
    default=_default_cache_dir,
    envvar="UASTHN_CACHE",
    metavar="DIR|none",
    help="Folder that keeps what xcorr sees in maps, up to"
    f" {MAX_CACHE_BYTES // 2**30} GiB, for later runs over the same ground: they are faster, their"
    " results the same.  [default: $UASTHN_CACHE, $XDG_CACHE_HOME/uasthn/features or"
    " ~/.cache/uasthn/features]",
)
