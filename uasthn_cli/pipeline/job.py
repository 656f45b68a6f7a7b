"""What one run is asked to do, and by which method it tells the uncertainty of its answers."""

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from uasthn_cli.config import Aggregation, GeotagConfig, Merge, PriorConfig, UeMethod
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.matching.registry import spec_of
from uasthn_cli.matching.spec import EstimatorSpec
from uasthn_cli.pipeline.parallel import cores_for_jobs, why_no_fork
from uasthn_cli.uncertainty.calibration import AnswerKind, Calibration, load_calibration
from uasthn_cli.uncertainty.methods import (
    OF_CROPS,
    OF_MEMBERS,
    Offer,
    UncertaintyChoice,
    paper_aggregation,
    refusal,
    richest_method,
)

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class BoxCalibration:
    """Stands for the calibration in the box, where one was made of such answers."""


BOX_CALIBRATION: Final = BoxCalibration()


@dataclass(frozen=True, slots=True)
class GeotagJob:
    """The inputs of one run.

    ``weights`` are files of networks: none for those in the box, the base network's, or also those
    of further members of an ensemble. ``calibration`` None: answers are judged by plain limits.
    ``cache_dir`` keeps map features for later runs (None: nowhere); it shapes how long the run
    takes and nothing else. So do ``jobs``, the frames that are looked at at once (None: as many as
    there are cores for).
    """

    log_path: Path
    frames_path: Path
    map_path: Path
    camera: CameraSpec
    prior: PriorConfig = field(default_factory=PriorConfig)
    frame_times_csv: Path | None = None
    config: GeotagConfig = field(default_factory=GeotagConfig)
    weights: tuple[Path, ...] = ()
    calibration: Calibration | BoxCalibration | None = BOX_CALIBRATION
    cache_dir: Path | None = None
    jobs: int | None = None

    @property
    def spec(self) -> EstimatorSpec:
        """What the estimator asked for is."""
        return spec_of(self.config.estimator)

    @property
    def base_weights(self) -> tuple[Path, ...]:
        """Files of the base network: of all networks where these are one estimator."""
        return self.weights if self.spec.averages else self.weights[:1]

    @property
    def member_weights(self) -> tuple[Path, ...]:
        """Files of the members that answer beside the base network, each for itself."""
        return () if self.spec.averages else self.weights[1:]


def chosen_calibration(job: GeotagJob, *, is_given: bool = False) -> Calibration | None:
    """Return the calibration that judges a job's answers; None: plain limits do.

    The one in the box speaks of its estimator with the weights that are the default, and neither of
    an estimator that the caller brings along (``is_given``) nor of another package's.

    Raises:
        CalibrationError: the file in the box is damaged.
    """
    if not isinstance(job.calibration, BoxCalibration):
        return job.calibration
    path = job.spec.calibration
    is_default = not (job.weights or job.config.ensemble or is_given)
    return load_calibration(path) if is_default and path is not None and path.exists() else None


def chosen_jobs(job: GeotagJob) -> int:
    """Return how many frames are looked at at once: as asked for, else one for each core.

    Raises:
        ValueError: several are asked for, and the estimator looks at one at a time.
    """
    if job.spec.works_in_processes:
        return cores_for_jobs() if job.jobs is None else job.jobs
    if job.jobs is not None and job.jobs > 1:
        raise ValueError(
            f"--estimator {job.config.estimator} looks at one frame at a time: leave out --jobs"
        )
    return 1


def settled_jobs(job: GeotagJob) -> int:
    """Return how many processes look at frames, now that everything is loaded, and say so."""
    asked, reason = chosen_jobs(job), why_no_fork()
    if asked > 1 and reason is not None:
        level = logging.INFO if job.jobs is None else logging.WARNING
        _log.log(level, "one process looks at all frames, not %d: %s", asked, reason)
        return 1
    _log.info("%d frames are looked at at once", asked)
    return asked


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
        has_head = job.spec.may_have_head
    members = 1 + len(job.member_weights)
    offer = Offer(config.estimator, config.crops.views, members, has_head, job.spec.has_ensemble)
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
    if job.spec.averages and method in OF_MEMBERS:
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
    calibration = chosen_calibration(job)
    if calibration is None:
        return None
    if job.spec.package is not None:
        return (
            f"no calibration judges {job.config.estimator}, which is of another package: add"
            " --calibration none"
        )
    if method is None:
        return None
    kind = AnswerKind(job.config.estimator, method)
    made_of = calibration.made_of
    if made_of is not None and made_of != kind:
        return (
            f"the calibration was made of {made_of} and promises nothing of {kind}: ask for the"
            " same, calibrate anew, or add --calibration none"
        )
    judgements = [calibration.single, calibration.fused]
    uses_deviations = any(
        term.signal == "u_m" for one in judgements if one for term in one.model.terms
    )
    if method is not UeMethod.NONE or not uses_deviations:
        return None
    asked = "--ue none" if job.config.ue else "one view of each frame"
    return f"{asked} leaves out u_m, by which the calibration judges: add --calibration none"
