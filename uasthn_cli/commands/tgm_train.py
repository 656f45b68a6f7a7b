"""``uasthn tgm train``: pairs in, a generator's weights and their model card out."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from uasthn_cli.commands.console import say
from uasthn_cli.commands.main import verbosity_options
from uasthn_cli.commands.options import camera_options
from uasthn_cli.commands.sections import SectionedCommand, section_option
from uasthn_cli.commands.training_options import (
    checkpoint_option,
    device_option,
    licence_option,
    network_option,
    replace_option,
    seed_option,
    training_option,
    weights_option,
)
from uasthn_cli.commands.training_progress import train_to_end

if TYPE_CHECKING:
    from uasthn_cli.datasets.samples import MatchDataset
    from uasthn_cli.ingest.cameras import CameraSpec
    from uasthn_cli.training.tgm.config import TgmConfig
    from uasthn_cli.training.tgm.run import TgmReport

GENERATORS: Final = ("unet", "resnet")
PRESETS: Final = ("paper-tgm", "laptop")

_EXAMPLES: Final = """\
\b
The paper's thermal generation, on a GPU, judged on the data set's validation part:
  uasthn tgm train boson/ --validate boson/ --out tgm.safetensors
\b
A narrow network on pairs of one's own, on a laptop:
  uasthn tgm train pairs.csv --preset laptop --out tgm.safetensors
\b
Interrupted? Give the same command again: it goes on from the last checkpoint.
"""

data_option = section_option("Data")

_CHECKPOINT_EVERY: Final = 500


class VerboseCommand(SectionedCommand):
    """A command within a group: the outer group gives ``-v`` and ``-q`` only to its own."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take what any command takes."""
        super().__init__(*args, **kwargs)
        self.params.extend(verbosity_options())


@click.command(cls=VerboseCommand, epilog=_EXAMPLES, short_help="Learn from pairs.")
@click.argument("dataset", metavar="DATASET")
@data_option(
    "--validate",
    "validation",
    metavar="DATASET",
    help="Pairs to judge by that are never trained on; of Boson-nighttime its part `val`.",
)
@data_option(
    "--samples",
    type=click.IntRange(min=1),
    metavar="N",
    help="Use the first N pairs only.  [default: all]",
)
@licence_option(data_option)
@camera_options
@training_option(
    "--preset",
    type=click.Choice(PRESETS),
    default=PRESETS[0],
    show_default=True,
    help="paper-tgm: pix2pix as published, 200 passes over all pairs; laptop: a quarter of its"
    " width, 8000 steps.",
)
@training_option(
    "--steps",
    type=click.IntRange(min=1),
    metavar="N",
    help="Batches to learn from.  [default: the preset's]",
)
@training_option(
    "--batch",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="N",
    help="Pairs in a batch.",
)
@seed_option
@network_option(
    "--generator",
    type=click.Choice(GENERATORS),
    default=GENERATORS[0],
    show_default=True,
    help="The network that draws: a U-Net of eight levels, or a ResNet of nine blocks.",
)
@network_option(
    "--width",
    type=click.IntRange(min=1),
    metavar="N",
    help="Channels next to the image, of generator and discriminator.  [default: the preset's]",
)
@device_option
@checkpoint_option(_CHECKPOINT_EVERY)
@weights_option
@replace_option
def train(
    dataset: str,
    validation: str | None,
    samples: int | None,
    licence_note: str | None,
    camera: "CameraSpec",
    preset: str,
    steps: int | None,
    batch: int,
    seed: int,
    generator: str,
    width: int | None,
    device: str,
    checkpoint_every: int,
    out: Path,
    overwrite: bool,
) -> None:
    """Learn from pairs to draw the thermal image of a satellite image (pix2pix).

    DATASET is what `uasthn evaluate` takes: a folder in the layout of Boson-nighttime, a table of
    pairs, a flight with its truth (which may need
    a camera option), or overhead images whose thermal views are rendered. What the
    satellite shows on the true footprint of each thermal image is what the generator sees.

    A run that was interrupted goes on from its checkpoint. On a CPU, with the same version and
    number of threads (OMP_NUM_THREADS), the same command gives the same weights bit by bit,
    interrupted or not.
    """
    from uasthn_cli.training.tgm.run import TgmJob, TgmRun

    pairs = _open_pairs(dataset, "train", camera, seed, samples)
    config = _config(preset, generator, width, len(pairs), steps, batch, seed, checkpoint_every)
    run = TgmRun(
        TgmJob(
            out=out,
            dataset=pairs,
            source=dataset,
            config=_on_device(config, device),
            validation=_open_pairs(validation, "val", camera, seed + 1) if validation else None,
            overwrite=overwrite,
            licence_note=licence_note,
        )
    )
    train_to_end(run, config.steps, _report_line)
    run.export()
    say(f"weights are in {out}, their model card in {run.paths.card}")


def _open_pairs(
    source: str, split: str, camera: "CameraSpec", seed: int, samples: int | None = None
) -> "MatchDataset":
    """Open a source with windows about the true places, so that footprints lie inside."""
    from uasthn_cli.datasets.opening import open_dataset
    from uasthn_cli.datasets.spec import DatasetSpec

    spec = DatasetSpec(max_offset_m=0.0, samples=samples, seed=seed, split=split, camera=camera)
    return open_dataset(source, spec)


def _config(
    preset: str,
    generator: str,
    width: int | None,
    pairs: int,
    steps: int | None,
    batch: int,
    seed: int,
    checkpoint_every: int,
) -> "TgmConfig":
    """Return a preset with what the options change."""
    from uasthn_cli.training.tgm.config import Preset, TgmConfig, preset_steps, preset_width
    from uasthn_cli.training.tgm.generators import GeneratorArchitecture, GeneratorKind

    width = width or preset_width(Preset(preset))
    return TgmConfig(
        steps=steps or preset_steps(Preset(preset), pairs, batch),
        batch=batch,
        seed=seed,
        checkpoint_every=checkpoint_every,
        architecture=GeneratorArchitecture(GeneratorKind(generator), width),
        discriminator_width=width,
    )


def _on_device(config: "TgmConfig", device: str) -> "TgmConfig":
    from dataclasses import replace

    from uasthn_cli.matching.device import choose_device

    return replace(config, device=choose_device(device))


def _report_line(report: "TgmReport", steps: int) -> str:
    losses = report.progress.losses
    line = (
        f"step {report.progress.step} of {steps}: L1 {losses.l1_grey:.2f} grey levels,"
        f" adversarial {losses.adversarial:.3f}, discriminator {losses.discriminator:.3f}"
    )
    if report.validation_l1_grey is None:
        return line
    return f"{line}; validation: L1 {report.validation_l1_grey:.2f} grey levels"
