"""Options of ``uasthn train``: what to learn from, and how, as one ``config`` argument."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from uasthn_cli.commands.matching_options import DEVICES
from uasthn_cli.commands.options import Decorator, gathered, output_option
from uasthn_cli.commands.parameter_types import ABOVE_ZERO
from uasthn_cli.commands.sections import section_option
from uasthn_cli.config import Precision, TrainingDefaults
from uasthn_cli.training.engine import PARTS

if TYPE_CHECKING:
    from uasthn_cli.training.trainee import TrainingConfig

_DEFAULTS: Final = TrainingDefaults()
_AT_LEAST_1: Final = click.IntRange(min=1)

training_option = section_option("Training")
network_option = section_option("Network")
machine_option = section_option("Machine")


seed_option: Final = training_option(
    "--seed",
    type=click.IntRange(min=0),
    default=_DEFAULTS.seed,
    show_default=True,
    metavar="N",
    help="Of the first weights and of every batch.",
)
device_option: Final = machine_option(
    "--device",
    type=click.Choice(DEVICES),
    default="auto",
    show_default=True,
    help="Where to train; auto: a GPU if there is one.",
)
weights_option: Final = output_option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    metavar="WEIGHTS.safetensors",
    help="The weights; WEIGHTS.md (model card), .log.csv and .checkpoint.pt lie beside them.",
)
replace_option: Final = output_option(
    "--overwrite", is_flag=True, help="Replace weights, card and log that are there."
)


def checkpoint_option(steps: int) -> Decorator:
    """Return ``--checkpoint-every`` with a default."""
    return machine_option(
        "--checkpoint-every",
        type=_AT_LEAST_1,
        default=steps,
        show_default=True,
        metavar="N",
        help="Steps between checkpoints, rows of the log and lines of progress.",
    )


def licence_option(data_option: Callable[..., Decorator]) -> Decorator:
    """Return ``--licence-note`` in the section of the help that says what is learnt from."""
    return data_option(
        "--licence-note",
        metavar="TEXT",
        help="Goes into the model card: whose the images are, and what may be done with them.",
    )


class ImagesType(click.ParamType[tuple[str, float]]):
    """A glob pattern, and after a last ``=`` a weight if what follows is a number."""

    name = "PATTERN[=WEIGHT]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """Return pattern and weight, 1 where none is given."""
        if isinstance(value, tuple):
            return value
        pattern, separator, number = str(value).rpartition("=")
        try:
            weight = float(number) if separator else None
        except ValueError:
            weight = None
        if weight is None:
            pattern, weight = str(value), 1.0
        if not (pattern and math.isfinite(weight) and weight > 0):
            self.fail(f"{value!r} is not a pattern, or its weight is not above 0", param, ctx)
        return pattern, weight


class WidthsType(click.ParamType[tuple[int, int, int, int]]):
    """Four numbers of channels, separated by commas."""

    name = "A,B,C,D"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int, int, int]:
        """Return the four numbers."""
        if isinstance(value, tuple):
            return value
        try:
            w1, w2, w3, w4 = (int(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not four whole numbers, say 16,32,48,64", param, ctx)
        if min(w1, w2, w3, w4) < 1:
            self.fail(f"{value!r} has a width below 1", param, ctx)
        return w1, w2, w3, w4


def _training_config(
    steps: int,
    learning_rate: float,
    windows: int,
    canvases: int,
    without: tuple[str, ...],
    widths: tuple[int, int, int, int] | None,
    channels: int | None,
    seed: int,
    device: str,
    precision: str,
    workers: int,
    checkpoint_every: int,
) -> "TrainingConfig":
    """Return how to train, with the device and precision of this machine."""
    from uasthn_cli.matching.architecture import XcorrArchitecture
    from uasthn_cli.matching.device import choose_device
    from uasthn_cli.training.engine import engine_without
    from uasthn_cli.training.precision import use_bfloat16
    from uasthn_cli.training.samples import SampleConfig
    from uasthn_cli.training.trainee import TrainingConfig

    chosen = choose_device(device)
    return TrainingConfig(
        steps=steps,
        learning_rate=learning_rate,
        seed=seed,
        device=chosen,
        bfloat16=use_bfloat16(Precision(precision), chosen),
        workers=workers,
        checkpoint_every=checkpoint_every,
        samples=SampleConfig(windows=windows, canvases=canvases, engine=engine_without(without)),
        architecture=XcorrArchitecture(
            channels or XcorrArchitecture().feature_channels, widths or XcorrArchitecture().widths
        ),
    )


training_options: Final = gathered(
    "config",
    _training_config,
    training_option(
        "--steps",
        type=_AT_LEAST_1,
        default=_DEFAULTS.steps,
        show_default=True,
        metavar="N",
        help="Batches that are learnt from; of dhn, ihn and sthn the preset says how many.",
    ),
    training_option(
        "--learning-rate",
        type=ABOVE_ZERO,
        default=_DEFAULTS.learning_rate,
        show_default=True,
        metavar="RATE",
        help="Of xcorr: held after a short warm-up, then falls to 0 over the last 30 % of the"
        " steps. Of the others 1e-4, falling to 0 from the first step.",
    ),
    training_option(
        "--windows",
        type=_AT_LEAST_1,
        default=_DEFAULTS.windows,
        show_default=True,
        metavar="N",
        help="Of xcorr: pieces of map in a batch.",
    ),
    training_option(
        "--canvases",
        type=_AT_LEAST_1,
        default=_DEFAULTS.canvases,
        show_default=True,
        metavar="N",
        help="Of xcorr: thermal views of each piece.",
    ),
    training_option(
        "--without",
        type=click.Choice(PARTS),
        multiple=True,
        metavar="PART",
        help="Of xcorr: switch off a part of the data engine, to see what it is worth; can be given"
        f" several times. Parts: {', '.join(PARTS)}.",
    ),
    seed_option,
    network_option(
        "--widths",
        type=WidthsType(),
        help="Of xcorr: channels of an encoder's four levels, each at half the resolution of the"
        " one before.  [default: as in the weights in the box]",
    ),
    network_option(
        "--channels",
        type=_AT_LEAST_1,
        metavar="N",
        help="Of xcorr: channels of the features.  [default: as in the weights in the box]",
    ),
    device_option,
    machine_option(
        "--precision",
        type=click.Choice([precision.value for precision in Precision]),
        default=Precision.AUTO.value,
        show_default=True,
        help="Number format of the encoders; auto: bfloat16 where the hardware computes in it.",
    ),
    machine_option(
        "--workers",
        type=click.IntRange(min=0),
        default=_DEFAULTS.workers,
        show_default=True,
        metavar="N",
        help="Processes that render batches; 0: none beside the one that trains.",
    ),
    checkpoint_option(_DEFAULTS.checkpoint_every),
)
