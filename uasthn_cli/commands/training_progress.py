"""What a person sees of a training run, whatever network it trains."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Protocol, TypeVar

import click

from uasthn_cli.commands.console import progress, say
from uasthn_cli.errors import RunInterruptedError

if TYPE_CHECKING:
    from uasthn_cli.training.export import OutputPaths
    from uasthn_cli.training.loop import Validation
    from uasthn_cli.training.run import Report

ReportT = TypeVar("ReportT")
ReportT_co = TypeVar("ReportT_co", covariant=True)


class WatchedRun(Protocol[ReportT_co]):
    """A run that tells how it goes after every checkpoint."""

    paths: "OutputPaths"
    saved_step: int

    @property
    def changes(self) -> Sequence[str]:
        """Settings that were changed on the way, as sentences."""

    def train(self, on_step: Callable[[int], None]) -> Iterator[ReportT_co]:
        """Train to the last step."""


def train_to_end(run: WatchedRun[ReportT], steps: int, line: Callable[[ReportT, int], str]) -> None:
    """Train, a line for every checkpoint: what ``line`` makes of a report and the steps.

    Raises:
        RunInterruptedError: Ctrl-C; says what is kept.
    """
    if run.saved_step:
        say(f"going on from step {run.saved_step} of {steps}, which {run.paths.checkpoint} holds")
    for change in run.changes:
        say(f"changed on the way: {change}")
    try:
        with progress("training", steps, done=run.saved_step, plain_lines=False) as advance:
            for report in run.train(on_step=advance):
                say(line(report, steps))
    except KeyboardInterrupt as interrupt:
        raise RunInterruptedError(_interrupted(run, steps)) from interrupt


def validated(validation: "Validation | None") -> str:
    """Return a validation in words."""
    if validation is None:
        return "no validation, as no other pairs were given"
    return (
        f"validation: median error {validation.median_error_px:.2f} px,"
        f" {validation.within_4_px:.1%} within 4 px"
    )


def as_typed(context: click.Context) -> Iterator[str]:
    """Yield the command as it was typed, arguments and options in the order of the help page."""
    yield from ("uasthn", "train")
    for option in context.command.params:
        name = option.name or ""
        if context.get_parameter_source(name) is not click.core.ParameterSource.COMMANDLINE:
            continue
        value = context.params.get(name)
        if isinstance(option, click.Argument):
            yield str(value)
        elif name == "images":
            for pattern, weight in value or ():
                yield from (option.opts[0], f"{pattern}={weight:.12g}")
        elif isinstance(option, click.Option) and option.is_flag:
            yield option.opts[0]
        elif isinstance(option, click.Option) and option.multiple:
            for part in value or ():
                yield from (option.opts[0], str(part))
        elif isinstance(value, tuple):
            yield from (option.opts[0], ",".join(map(str, value)))
        else:
            yield from (option.opts[0], str(value))


def report_line(report: "Report", steps: int) -> str:
    """Return how the training of a network that locates goes."""
    figures = report.progress
    line = (
        f"step {figures.step} of {steps}: loss {figures.loss:.3f},"
        f" median error {figures.median_error_px:.2f} px, {figures.within_4_px:.1%} within 4 px"
    )
    return line if report.validation is None else f"{line}; {validated(report.validation)}"


def _interrupted(run: WatchedRun[ReportT], steps: int) -> str:
    if run.saved_step == 0:
        return "interrupted before the first checkpoint; nothing is kept"
    return (
        f"interrupted; step {run.saved_step} of {steps} is kept in {run.paths.checkpoint}:"
        " give the same command again to go on"
    )
