"""``uasthn train``: overhead images in, network weights and their model card out."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from uasthn_cli.commands.console import progress, say
from uasthn_cli.commands.options import output_option
from uasthn_cli.commands.parameter_types import FiniteRange
from uasthn_cli.commands.sections import SectionedCommand, section_option
from uasthn_cli.commands.training_options import (
    ImagesType,
    network_option,
    training_option,
    training_options,
)
from uasthn_cli.config import TrainingDefaults
from uasthn_cli.errors import RunInterruptedError

if TYPE_CHECKING:
    from uasthn_cli.training.loop import Validation
    from uasthn_cli.training.run import Report, TrainingRun
    from uasthn_cli.training.scenes import RenderedShares
    from uasthn_cli.training.trainee import TrainingConfig

_EXAMPLES: Final = """\
\b
On GeoTIFFs and aerial photographs, the photographs drawn half as often (quote
the patterns, the shell must not expand them):
  uasthn train --images 'maps/**/*.tif' --images 'photos/*.jpg=0.5' \\
      --licence-note 'maps: public domain; photos: CC BY 4.0' --out my.safetensors
  uasthn geotag flight.tlog frames/ --map map.tif --hfov 45 \\
      --weights my.safetensors --out out/flight
\b
Without any image, on rendered places only:
  uasthn train --sand-share 0.4 --landscape-share 0.6 --steps 1000 --out rendered.safetensors
\b
Interrupted? Give the same command again: it goes on from the last checkpoint.
"""

_DEFAULTS: Final = TrainingDefaults()
_ROUNDING: Final = 1e-9

data_option = section_option("Data")


@click.command(
    cls=SectionedCommand, epilog=_EXAMPLES, short_help="Train the network on overhead images."
)
@data_option(
    "--images",
    type=ImagesType(),
    multiple=True,
    help="GeoTIFFs or plain images by glob pattern (** for folders within), and how often they"
    " are drawn [default: 1]; can be given several times. GeoTIFFs of one area and grid count as"
    " dates of one place. All images are kept in memory.",
)
@data_option(
    "--sand-share",
    type=FiniteRange(0, 1),
    default=_DEFAULTS.sand_share,
    show_default=True,
    metavar="SHARE",
    help="Share of what is trained on that is rendered sand instead.",
)
@data_option(
    "--landscape-share",
    type=FiniteRange(0, 1),
    metavar="SHARE",
    help="Share that is rendered landscapes (see `uasthn synth`). Where both shares add up to 1, no"
    f" images are needed.  [default: {_DEFAULTS.landscape_share:g}, or what --sand-share leaves]",
)
@data_option(
    "--licence-note",
    metavar="TEXT",
    help="Goes into the model card: whose the images are, and what may be done with them.",
)
@training_options
@training_option(
    "--validate-every",
    type=click.IntRange(min=1),
    default=_DEFAULTS.validate_every,
    show_default=True,
    metavar="N",
    help="Steps between looks at batches that are never trained on.",
)
@network_option(
    "--init",
    type=click.Path(path_type=Path),
    metavar="WEIGHTS.safetensors",
    help="Start from these weights, which also say how large the network is, with a new optimiser;"
    " not from random ones.",
)
@output_option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    metavar="WEIGHTS.safetensors",
    help="The weights; WEIGHTS.md (model card), .log.csv and .checkpoint.pt lie beside them.",
)
@output_option("--overwrite", is_flag=True, help="Replace weights, card and log that are there.")
def train(
    images: tuple[tuple[str, float], ...],
    sand_share: float,
    landscape_share: float | None,
    licence_note: str | None,
    validate_every: int,
    init: Path | None,
    out: Path,
    overwrite: bool,
    config: "TrainingConfig",
) -> None:
    """Train the network on overhead images; no thermal image is needed.

    What a thermal camera would see is rendered from the images, in another way for every batch.
    A run that was interrupted goes on from its checkpoint, which stays when the run is finished:
    more --steps go on from there, deleting it starts anew.

    The seed decides the first weights and the content and order of all batches. On a CPU, with the
    same version and number of threads (OMP_NUM_THREADS), the same command gives the same weights
    bit by bit, interrupted or not; a GPU adds in varying order, so there the last digits differ.
    """
    from uasthn_cli.training.run import TrainingJob, TrainingRun

    asked = click.get_current_context().params
    if init is not None and (asked["widths"] or asked["channels"]):
        raise click.UsageError("--init says how large the network is: leave --widths, --channels")
    run = TrainingRun(
        TrainingJob(
            out=out,
            images=images,
            rendered=_rendered_shares(sand_share, landscape_share, bool(images)),
            config=config,
            validate_every=validate_every,
            overwrite=overwrite,
            licence_note=licence_note,
            command_line=shlex.join(_typed(click.get_current_context())),
            initial_weights=init,
        )
    )
    _say_start(run, config.steps)
    try:
        _train(run, config.steps)
    except KeyboardInterrupt as interrupt:
        raise RunInterruptedError(_interrupted(run, config.steps)) from interrupt
    say(f"{_validated(run.export())}; weights are in {out}, their model card in {run.paths.card}")


def _rendered_shares(
    sand_share: float, landscape_share: float | None, has_images: bool
) -> "RenderedShares":
    """Return how much is rendered, and refuse shares that do not go with the images given."""
    from uasthn_cli.training.scenes import RenderedShares

    if landscape_share is None:
        landscape_share = min(_DEFAULTS.landscape_share, 1 - sand_share)
    rendered_share = sand_share + landscape_share
    if rendered_share > 1 + _ROUNDING:
        raise click.UsageError("--sand-share and --landscape-share add up to more than 1")
    is_all_rendered = rendered_share > 1 - _ROUNDING
    if not has_images and not is_all_rendered:
        raise click.UsageError(
            "give --images, or shares that add up to 1, say --sand-share 0.4 --landscape-share 0.6"
        )
    if has_images and is_all_rendered:
        raise click.UsageError("--sand-share and --landscape-share leave nothing for --images")
    return RenderedShares(sand_share, landscape_share)


def _typed(context: click.Context) -> Iterator[str]:
    """Yield the command as it was typed, options in the order of the help page."""
    yield from ("uasthn", "train")
    for option in context.command.params:
        name = option.name or ""
        if context.get_parameter_source(name) is not click.core.ParameterSource.COMMANDLINE:
            continue
        value = context.params.get(name)
        if name == "images":
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


def _say_start(run: "TrainingRun", steps: int) -> None:
    if run.saved_step:
        say(f"going on from step {run.saved_step} of {steps}, which {run.paths.checkpoint} holds")
    for change in run.changes:
        say(f"changed on the way: {change}")


def _train(run: "TrainingRun", steps: int) -> None:
    with progress("training", steps, done=run.saved_step, plain_lines=False) as advance:
        for report in run.train(on_step=advance):
            say(_report_line(report, steps))


def _report_line(report: "Report", steps: int) -> str:
    figures = report.progress
    line = (
        f"step {figures.step} of {steps}: loss {figures.loss:.3f},"
        f" median error {figures.median_error_px:.2f} px, {figures.within_4_px:.1%} within 4 px"
    )
    return line if report.validation is None else f"{line}; {_validated(report.validation)}"


def _validated(validation: "Validation") -> str:
    return (
        f"validation: median error {validation.median_error_px:.2f} px,"
        f" {validation.within_4_px:.1%} within 4 px"
    )


def _interrupted(run: "TrainingRun", steps: int) -> str:
    if run.saved_step == 0:
        return "interrupted before the first checkpoint; nothing is kept"
    return (
        f"interrupted; step {run.saved_step} of {steps} is kept in {run.paths.checkpoint}:"
        " give the same command again to go on"
    )
