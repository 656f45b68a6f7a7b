"""Options of the search and of the decision: gathered into one ``config`` argument."""

from typing import Final

import click

from uasthn_cli.commands.options import gathered
from uasthn_cli.commands.parameter_types import (
    ABOVE_ZERO,
    EstimatorType,
    FiniteRange,
    StdThresholdType,
)
from uasthn_cli.commands.sections import section_option
from uasthn_cli.config import (
    FALLBACK_MAX_STD_M,
    FALLBACK_MIN_CONFIDENCE,
    TOLERANCE_M,
    Aggregation,
    CropTtaConfig,
    DecisionConfig,
    GeotagConfig,
    Merge,
    Rule,
    Sampling,
    UeMethod,
)

DEVICES: Final = ("auto", "cpu", "cuda")

_CONFIG: Final = GeotagConfig()

search_option = section_option("Search")
flight_option = section_option("Flight")
trust_option = section_option("Trust")


def _geotag_config(
    search_radius_m: float,
    gsd_m: float | None,
    estimator: str,
    device: str,
    symmetries: int,
    ue_iterations: int | None,
    ensemble: bool,
    views: int,
    crop_sampling: str,
    crop_offset_fraction: float,
    seed: int,
    ue: str | None,
    merge: str | None,
    aggregation: str | None,
    fuse: bool,
    map_error_m: float,
    attitude_error_deg: float,
    max_std: tuple[float, str] | None,
    rule: str,
    min_confidence: float | None,
) -> GeotagConfig:
    """Return everything that shapes the result apart from inputs, camera and clock."""
    limit, unit = max_std or (None, "m")
    return GeotagConfig(
        estimator=estimator,
        search_radius_m=search_radius_m,
        gsd_m=gsd_m,
        device=device,
        symmetries=symmetries,
        ue_iterations=ue_iterations,
        ensemble=ensemble,
        crops=CropTtaConfig(views, Sampling(crop_sampling), crop_offset_fraction, seed),
        ue=None if ue is None else UeMethod(ue),
        merge=None if merge is None else Merge(merge),
        aggregation=None if aggregation is None else Aggregation(aggregation),
        fuse=fuse,
        map_error_m=map_error_m,
        attitude_error_deg=attitude_error_deg,
        decision=DecisionConfig(
            max_std_m=limit if unit == "m" else None,
            max_std_px=limit if unit == "px" else None,
            rule=Rule(rule),
            min_confidence=min_confidence,
        ),
    )


matching_options: Final = gathered(
    "config",
    _geotag_config,
    search_option(
        "--search-radius",
        "search_radius_m",
        type=ABOVE_ZERO,
        default=_CONFIG.search_radius_m,
        metavar="M",
        show_default=True,
        help="How far from the logged position a frame may lie.",
    ),
    search_option(
        "--gsd",
        "gsd_m",
        type=ABOVE_ZERO,
        metavar="M",
        help="Ground size of a pixel in the comparison.  [default: from height and camera]",
    ),
    search_option(
        "--estimator",
        type=EstimatorType(),
        default=_CONFIG.estimator,
        show_default=True,
        help="Learned cross-correlation, plain normalised correlation of grey values, a network of"
        " the paper's (give --weights), a matcher of the vismatch package, or one that another"
        " installed package offers.",
    ),
    search_option(
        "--device",
        type=click.Choice(DEVICES),
        default=_CONFIG.device,
        show_default=True,
        help="Where networks run; auto: a GPU if there is one.",
    ),
    search_option(
        "--symmetries",
        type=click.IntRange(1, 8),
        default=_CONFIG.symmetries,
        metavar="N",
        show_default=True,
        help="Orientations (1 to 8) in which xcorr sees frame and map; fewer are faster.",
    ),
    search_option(
        "--ue-iterations",
        type=click.IntRange(min=1),
        metavar="K",
        help="Of ihn and sthn: all views take K steps together, then the whole frame goes on alone"
        " (the paper's early stopping).  [default: all steps]",
    ),
    search_option(
        "--ensemble",
        is_flag=True,
        help="Average the scores of the three networks in the box instead of using one: slower.",
    ),
    flight_option(
        "--fuse/--no-fuse",
        default=_CONFIG.fuse,
        show_default=True,
        help="Let the whole flight settle every frame, or let each stand alone.",
    ),
    trust_option(
        "--map-error",
        "map_error_m",
        type=FiniteRange(min=0),
        default=_CONFIG.map_error_m,
        metavar="M",
        show_default=True,
        help="Standard deviation of the map's own registration, each way: part of every"
        " uncertainty.",
    ),
    trust_option(
        "--attitude-error",
        "attitude_error_deg",
        type=FiniteRange(min=0),
        default=_CONFIG.attitude_error_deg,
        metavar="DEG",
        show_default=True,
        help="Standard deviation of the camera's roll, and of its pitch, mount included, where the"
        " flight does not tell: part of the uncertainty of the camera's position.",
    ),
    trust_option(
        "--ue",
        type=click.Choice([method.value for method in UeMethod]),
        help="What tells how uncertain a frame's own answer is: none, its crops (croptta), the"
        " networks of an ensemble (de), both, or the network itself (dm, Direct Modeling)."
        "  [default: all that the run allows, dm where there is nothing else]",
    ),
    trust_option(
        "--merge",
        type=click.Choice([merge.value for merge in Merge]),
        help="How croptta+de makes one uncertainty of two.  [default: max]",
    ),
    trust_option(
        "--crops",
        "--views",
        "views",
        type=click.IntRange(min=1),
        default=_CONFIG.crops.views,
        metavar="N",
        show_default=True,
        help="Views of each frame that must agree, the whole frame among them.",
    ),
    trust_option(
        "--crop-sampling",
        type=click.Choice([sampling.value for sampling in Sampling]),
        default=_CONFIG.crops.sampling.value,
        show_default=True,
        help="How the crops are placed.",
    ),
    trust_option(
        "--crop-offset",
        "crop_offset_fraction",
        type=FiniteRange(0, 0.5, min_open=True, max_open=True),
        default=_CONFIG.crops.offset_fraction,
        metavar="FRACTION",
        show_default=True,
        help="How far crops are shifted, as a share of the frame's width.",
    ),
    trust_option(
        "--seed",
        type=click.IntRange(min=0),
        default=_CONFIG.crops.seed,
        metavar="N",
        show_default=True,
        help="Seed of the random crops.",
    ),
    trust_option(
        "--aggregation",
        type=click.Choice([aggregation.value for aggregation in Aggregation]),
        help="The answer: the whole frame's own by the first network, or the mean of an ensemble's,"
        " without one of all views.  [default: as the paper has it, the mean of an ensemble, else"
        " the original]",
    ),
    trust_option(
        "--max-std",
        type=StdThresholdType(),
        metavar="10m|4px",
        help="Standard deviation of the corners (by --ue) beyond which a frame's own answer is"
        " rejected: metres on the ground, or pixels of the search window at the paper's width of"
        " 256."
        f"  [default: left to the calibration; {FALLBACK_MAX_STD_M:g}m without one]",
    ),
    trust_option(
        "--rule",
        type=click.Choice([rule.value for rule in Rule]),
        default=_CONFIG.decision.rule.value,
        show_default=True,
        help="Reject when all of the eight deviations are beyond the limit, any is, or their mean"
        " is.",
    ),
    trust_option(
        "--min-confidence",
        type=FiniteRange(0, 1),
        metavar="SHARE",
        help=f"Reject as ambiguous when less of the posterior lies within {TOLERANCE_M:g} m of the"
        " answer."
        f"  [default: left to the calibration; {FALLBACK_MIN_CONFIDENCE:g} without one]",
    ),
)
