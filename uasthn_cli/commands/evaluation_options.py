"""Options of ``uasthn evaluate``, gathered into ``data``, ``views`` and ``judging``."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from uasthn_cli.commands.matching_options import DEVICES
from uasthn_cli.commands.options import gathered, given_options
from uasthn_cli.commands.parameter_types import (
    ABOVE_ZERO,
    EstimatorType,
    FiniteRange,
    StdThresholdType,
)
from uasthn_cli.commands.sections import section_option
from uasthn_cli.commands.window_options import window_options
from uasthn_cli.config import (
    DEFAULT_SYMMETRIES,
    FALLBACK_MAX_STD_M,
    PAPER_THERMAL_PX,
    Aggregation,
    CropTtaConfig,
    DecisionConfig,
    GeotagConfig,
    Merge,
    Rule,
    Sampling,
    UeMethod,
)

if TYPE_CHECKING:
    from uasthn_cli.evaluation.judging import JudgingConfig

UE_METHODS: Final = tuple(method.value for method in UeMethod)

_OF_DRAWING: Final = {
    *("inputs", "is_from", "is_stress", "methods", "aggregation", "merge", "max_std", "rule"),
    *("tolerance_m", "out", "with_figures", "overwrite"),
}
"""Parameters that mean something for predictions made before."""

data_option = section_option("Data")
estimator_option = section_option("Estimator")
uncertainty_option = section_option("Uncertainty")
stress_option = section_option("Stress")

_CROPS: Final = CropTtaConfig()


class UeType(click.ParamType["tuple[UeMethod, ...]"]):
    """Methods of uncertainty estimation, separated by commas."""

    name = "METHOD[,METHOD…]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> "tuple[UeMethod, ...]":
        """Return the methods in the order given, each once."""
        names = dict.fromkeys(part.strip() for part in str(value).split(","))
        unknown = [name for name in names if name not in UE_METHODS]
        if unknown:
            self.fail(f"{unknown[0]!r} is none of {', '.join(UE_METHODS)}", param, ctx)
        return tuple(UeMethod(name) for name in names)


def _crops(views: int, sampling: str, offset_px: float, seed: int) -> CropTtaConfig:
    """Return how views are cropped."""
    return CropTtaConfig(views, Sampling(sampling), offset_px / PAPER_THERMAL_PX, seed)


def _judging(
    aggregation: str | None, merge: str, max_std: tuple[float, str] | None, rule: str
) -> "JudgingConfig":
    """Return how predictions become accepted or rejected answers."""
    from uasthn_cli.evaluation.judging import JudgingConfig

    limit, unit = max_std or (None, "m")
    decision = DecisionConfig(
        max_std_m=limit if unit == "m" else None,
        max_std_px=limit if unit == "px" else None,
        rule=Rule(rule),
    )
    chosen = None if aggregation is None else Aggregation(aggregation)
    return JudgingConfig(decision, Merge(merge), chosen)


def data_options(command: Any) -> Any:
    """Add what is cut out of the data."""
    for option in reversed(_DATA_OPTIONS):
        command = option(command)
    return command


def estimator_options(command: Any) -> Any:
    """Add who answers."""
    for option in reversed(_ESTIMATOR_OPTIONS):
        command = option(command)
    return command


crop_options: Final = gathered(
    "crops",
    _crops,
    uncertainty_option(
        "--views",
        type=click.IntRange(min=1),
        default=_CROPS.views,
        show_default=True,
        metavar="N",
        help="Views of each thermal image for CropTTA, the whole image among them.",
    ),
    uncertainty_option(
        "--sampling",
        type=click.Choice([sampling.value for sampling in Sampling]),
        default=_CROPS.sampling.value,
        show_default=True,
        help="How crops are placed.",
    ),
    uncertainty_option(
        "--offset",
        "offset_px",
        type=FiniteRange(0, PAPER_THERMAL_PX / 2, min_open=True, max_open=True),
        default=_CROPS.offset_fraction * PAPER_THERMAL_PX,
        show_default=True,
        metavar="PX",
        help="Crop offset o_c, in pixels of a thermal image 512 wide as in the paper.",
    ),
    uncertainty_option(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        metavar="N",
        help="Seed of crops, offsets and rendered pairs.",
    ),
)

judging_options: Final = gathered(
    "judging",
    _judging,
    uncertainty_option(
        "--aggregation",
        type=click.Choice([aggregation.value for aggregation in Aggregation]),
        help="The answer: the whole image's own, or the mean.  [default: as the paper has it, the"
        " mean of an ensemble, else the original]",
    ),
    uncertainty_option(
        "--merge",
        type=click.Choice([merge.value for merge in Merge]),
        default=Merge.MAX.value,
        show_default=True,
        help="How croptta+de makes one uncertainty of two.",
    ),
    uncertainty_option(
        "--max-std",
        type=StdThresholdType(),
        metavar="10m|4px",
        help="Rejection threshold s_c: metres on the ground, or pixels of the satellite window at"
        f" the paper's width of 256.  [default: {FALLBACK_MAX_STD_M:g}m]",
    ),
    uncertainty_option(
        "--rule",
        type=click.Choice([rule.value for rule in Rule]),
        default=Rule.ALL.value,
        show_default=True,
        help="Reject when all of the eight deviations are beyond the threshold (the paper's), any"
        " is, or their mean is.",
    ),
)

_DATA_OPTIONS: Final = (
    data_option(
        "--dc",
        "offsets_m",
        type=ABOVE_ZERO,
        multiple=True,
        metavar="M",
        help="D_C: the farthest that the satellite window's middle lies from the thermal image's;"
        " several times for a table of several.  [default: 512; a flight: where the log has it]",
    ),
    *window_options(data_option),
    data_option(
        "--samples",
        type=click.IntRange(min=1),
        metavar="N",
        help="How many pairs are used, spread over the data set.  [default: all; 100 if rendered]",
    ),
    data_option(
        "--split",
        type=click.Choice(["train", "val", "test", "extended"]),
        default="test",
        show_default=True,
        help="Part of Boson-nighttime.",
    ),
)

_ESTIMATOR_OPTIONS: Final = (
    estimator_option(
        "--estimator",
        type=EstimatorType(),
        default=GeotagConfig().estimator,
        show_default=True,
        help="Who locates the thermal image.",
    ),
    estimator_option(
        "--weights",
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        multiple=True,
        metavar="FILE",
        help="Weights instead of those in the box; given several times, a deep ensemble whose first"
        " member is the base network.",
    ),
    estimator_option(
        "--ensemble", is_flag=True, help="The three networks in the box as a deep ensemble."
    ),
    estimator_option(
        "--device",
        type=click.Choice(DEVICES),
        default="auto",
        show_default=True,
        help="Where networks run; auto: a GPU if there is one.",
    ),
    estimator_option(
        "--symmetries",
        type=click.IntRange(1, 8),
        default=DEFAULT_SYMMETRIES,
        show_default=True,
        metavar="N",
        help="Orientations (1 to 8) in which xcorr sees both images; fewer are faster.",
    ),
    estimator_option(
        "--ue-iterations",
        type=click.IntRange(min=1),
        metavar="K",
        help="Of ihn and sthn: all views take K steps together, then the whole image goes on"
        " alone (the paper's early stopping).  [default: all steps]",
    ),
    estimator_option(
        "--width",
        "width_px",
        type=click.IntRange(min=16),
        metavar="PX",
        help="Width at which the thermal image is matched, never enlarged.  [default: 96 for xcorr"
        " and ncc, else its own]",
    ),
)


def refuse_predicting_options() -> None:
    """Refuse options that shape predictions where those are already made.

    Raises:
        click.UsageError: one was given.
    """
    context = click.get_current_context()
    for option in given_options(context, context.params.keys() - _OF_DRAWING):
        raise click.UsageError(
            f"{option} shapes predictions, and --from draws from those that are made: evaluate the"
            " data again"
        )
