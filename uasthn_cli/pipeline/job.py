"""What one run is asked to do, and by which method it tells the uncertainty of its answers."""

from dataclasses import dataclass, field
from pathlib import Path

from uasthn_cli.config import Aggregation, GeotagConfig, Merge, PriorConfig, UeMethod
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.matching.registry import AVERAGING_ESTIMATORS, DISPLACEMENT_ESTIMATORS
from uasthn_cli.uncertainty.calibration import AnswerKind, Calibration
from uasthn_cli.uncertainty.methods import (
    OF_CROPS,
    OF_MEMBERS,
    Offer,
    UncertaintyChoice,
    paper_aggregation,
    refusal,
    richest_method,
)


@dataclass(frozen=True, slots=True)
class GeotagJob:
    """The inputs of one run.

    ``weights`` are files of networks: none for those in the box, the base network's, or also those
    of further members of an ensemble. ``cache_dir`` keeps map features for later runs (None:
    nowhere); it shapes how long the run takes and nothing else.
    """

    log_path: Path
    frames_path: Path
    map_path: Path
    camera: CameraSpec
    prior: PriorConfig = field(default_factory=PriorConfig)
    frame_times_csv: Path | None = None
    config: GeotagConfig = field(default_factory=GeotagConfig)
    weights: tuple[Path, ...] = ()
    calibration: Calibration | None = None
    cache_dir: Path | None = None

    @property
    def member_weights(self) -> tuple[Path, ...]:
        """Files of the members that answer beside the base network, each for itself."""
        return () if self.config.estimator in AVERAGING_ESTIMATORS else self.weights[1:]


def chosen_uncertainty(job: GeotagJob, *, has_head: bool | None = None) -> UncertaintyChoice:
    """Return how a run tells its answers' uncertainty: as asked for, else with all that it has.

    ``has_head`` None: weights were not looked into yet, and may have Direct Modeling's second head
    if there are networks with one.

    Raises:
        ValueError: what is asked for contradicts itself, in one line.
    """
    config = job.config
    is_supposed = has_head is None and config.ue is None
    if has_head is None:
        has_head = config.estimator in DISPLACEMENT_ESTIMATORS
    members = 1 + len(job.member_weights)
    offer = Offer(config.estimator, config.crops.views, members, has_head)
    method = config.ue or richest_method(offer)
    why = (
        _unfit_members(job, method)
        or refusal(method, offer)
        or _unfit_settings(config, method)
        or _unfit_calibration(job, None if is_supposed and method is UeMethod.DM else method)
    )
    if why is not None:
        raise ValueError(why)
    return UncertaintyChoice(
        method=method,
        merge=config.merge or Merge.MAX,
        aggregation=config.aggregation or paper_aggregation(method),
    )


def _unfit_members(job: GeotagJob, method: UeMethod) -> str | None:
    """Return why the weights make no ensemble for a method, or None."""
    name = job.config.estimator
    files = [path.resolve() for path in job.weights]
    twice = [path for path in files if files.count(path) > 1]
    if twice:
        return f"{twice[0]} is given twice: a network always agrees with itself"
    if name in AVERAGING_ESTIMATORS and method in OF_MEMBERS:
        return (
            f"--ue {method} needs members that answer one by one: {name} averages the scores of its"
            f" networks into one answer, which --ue {UeMethod.CROPTTA} can judge"
        )
    if job.member_weights and method not in OF_MEMBERS:
        return f"--ue {method} asks one network alone: give --weights once"
    return None


def _unfit_settings(config: GeotagConfig, method: UeMethod) -> str | None:
    """Return which setting has no meaning for a method, and why, or None."""
    is_mean = config.aggregation is Aggregation.MEAN
    decision = config.decision
    if config.merge is not None and method is not UeMethod.CROPTTA_DE:
        return f"--merge is of --ue {UeMethod.CROPTTA_DE}: {method} has nothing to merge"
    if is_mean and method in (UeMethod.NONE, UeMethod.DM):
        return f"--aggregation mean needs several answers, and --ue {method} has one"
    if config.ue_iterations is not None and method not in OF_CROPS:
        return f"--ue-iterations stops crops early, and --ue {method} looks at none"
    if config.ue_iterations is not None and is_mean and method is UeMethod.CROPTTA:
        return "--ue-iterations leaves one view to answer: leave out --aggregation mean"
    if method is UeMethod.NONE and (decision.max_std_m or decision.max_std_px):
        return f"--max-std limits deviations, and --ue {method} has none"
    return None


def _unfit_calibration(job: GeotagJob, method: UeMethod | None) -> str | None:
    """Return why a calibration cannot judge answers by a method (None: not known yet), or None."""
    if job.calibration is None or method is None:
        return None
    kind = AnswerKind(job.config.estimator, method)
    made_of = job.calibration.made_of
    if made_of is not None and made_of != kind:
        return (
            f"the calibration was made of {made_of} and promises nothing of {kind}: ask for the"
            " same, calibrate anew, or add --calibration none"
        )
    judgements = [job.calibration.single, job.calibration.fused]
    uses_deviations = any(
        term.signal == "u_m" for one in judgements if one for term in one.model.terms
    )
    if method is not UeMethod.NONE or not uses_deviations:
        return None
    asked = "--ue none" if job.config.ue else "one view of each frame"
    return f"{asked} leaves out u_m, by which the calibration judges: add --calibration none"
