"""``uasthn train``: overhead images in, network weights and their model card out."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from uasthn_cli.commands.console import say
from uasthn_cli.commands.displacement_options import (
    AskedDisplacement,
    displacement_options,
)
from uasthn_cli.commands.options import camera_options
from uasthn_cli.commands.parameter_types import FiniteRange
from uasthn_cli.commands.sections import SectionedCommand, section_option
from uasthn_cli.commands.train_displacement import (
    refuse_displacement_options,
    train_displacement,
)
from uasthn_cli.commands.training_options import (
    ImagesType,
    licence_option,
    network_option,
    replace_option,
    training_option,
    training_options,
    weights_option,
)
from uasthn_cli.commands.training_progress import as_typed, report_line, train_to_end, validated
from uasthn_cli.config import TrainingDefaults
from uasthn_cli.matching.registry import TRAINED_HERE, XCORR

if TYPE_CHECKING:
    from uasthn_cli.ingest.cameras import CameraSpec
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
A network of a quarter of the cost that sees what a larger one sees:
  uasthn train --images 'maps/*.tif' --teacher large.safetensors --widths 16,32,64,96 \\
      --channels 8 --steps 1400 --learning-rate 0.003 --out small.safetensors
\b
The paper's two-stage network on pairs, on a GPU; then its first stage alone as
one of five members of an ensemble:
  uasthn train boson/ --network sthn --preset paper-sthn --out sthn.safetensors
  uasthn train boson/ --network ihn --preset paper-ihn --seed 1 --out ihn-1.safetensors
\b
Interrupted? Give the same command again: it goes on from the last checkpoint.
"""

_DEFAULTS: Final = TrainingDefaults()
_ROUNDING: Final = 1e-9

data_option = section_option("Data of xcorr")


@click.command(
    cls=SectionedCommand, epilog=_EXAMPLES, short_help="Train a network on images or pairs."
)
@network_option(
    "--network",
    type=click.Choice(TRAINED_HERE),
    default=XCORR.name,
    show_default=True,
    help="Which estimator's network.",
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
@licence_option(data_option)
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
@network_option(
    "--teacher",
    type=click.Path(path_type=Path),
    metavar="WEIGHTS.safetensors",
    help="Of xcorr: learn the features of this network instead of the search (distillation): for a"
    " smaller one that is nearly as good.",
)
@displacement_options
@camera_options
@weights_option
@replace_option
def train(
    images: tuple[tuple[str, float], ...],
    sand_share: float,
    landscape_share: float | None,
    licence_note: str | None,
    validate_every: int,
    init: Path | None,
    teacher: Path | None,
    out: Path,
    overwrite: bool,
    network: str,
    asked: AskedDisplacement,
    camera: "CameraSpec",
    config: "TrainingConfig",
) -> None:
    """Train a network; for `xcorr`, on overhead images, no thermal image is needed.

    The paper's networks `dhn`, `ihn` and `sthn` learn from a DATASET of pairs: Boson-nighttime, a
    table of pairs, a flight with truth, or overhead images whose thermal views are rendered.

    What a thermal camera would see is rendered from the images, in another way for every batch.
    A run that was interrupted goes on from its checkpoint, which stays when the run is finished:
    more --steps go on from there, deleting it starts anew.

    The seed decides the first weights and the content and order of all batches. On a CPU, with the
    same version and number of threads (OMP_NUM_THREADS), the same command gives the same weights
    bit by bit, interrupted or not; a GPU adds in varying order, so there the last digits differ.
    """
    context = click.get_current_context()
    if network != XCORR.name:
        if teacher is not None:
            raise click.UsageError("--teacher is for xcorr, not for --network dhn, ihn or sthn")
        train_displacement(context, asked, camera)
        return
    refuse_displacement_options(context)

    from uasthn_cli.training.run import TrainingJob, TrainingRun

    if init is not None and (context.params["widths"] or context.params["channels"]):
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
            command_line=shlex.join(as_typed(context)),
            initial_weights=init,
            teacher=teacher,
        )
    )
    train_to_end(run, config.steps, report_line)
    say(f"{validated(run.export())}; weights are in {out}, their model card in {run.paths.card}")


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
