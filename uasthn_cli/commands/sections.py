"""Help pages whose options stand in named sections, with worked examples at the bottom."""

from collections.abc import Callable
from typing import Any

import click

_OTHER = "Other"


class SectionedOption(click.Option):
    """An option that knows under which heading of the help page it stands."""

    def __init__(self, *args: Any, section: str = _OTHER, **kwargs: Any) -> None:
        """Take the heading besides what any option takes."""
        super().__init__(*args, **kwargs)
        self.section = section


class SectionedCommand(click.Command):
    """A command whose help page groups its options by section, in the order they were declared."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, a heading per section."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                section = getattr(parameter, "section", _OTHER)
                sections.setdefault(section, []).append(record)
        sections[_OTHER] = sections.pop(_OTHER)  # --help and its like come last
        for section, records in sections.items():
            with formatter.section(section):
                formatter.write_dl(records)


def section_option(
    section: str,
) -> Callable[..., Callable[[Callable[..., Any]], Callable[..., Any]]]:
    """Return a stand-in for ``click.option`` whose options stand under a heading."""

    def option(*declarations: str, **attributes: Any) -> Callable[..., Any]:
        return click.option(*declarations, cls=SectionedOption, section=section, **attributes)

    return option
