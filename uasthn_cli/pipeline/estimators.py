"""Open the networks of a run: the base network, and further members of its ensemble."""

import logging
from dataclasses import replace

from uasthn_cli.config import COARSE_REFINE_SYMMETRIES
from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.device import choose_device
from uasthn_cli.matching.registry import open_estimator
from uasthn_cli.matching.spec import WeightsUse
from uasthn_cli.pipeline.job import GeotagJob, chosen_uncertainty
from uasthn_cli.seam import Estimator, SelfAssessor
from uasthn_cli.uncertainty.methods import UncertaintyChoice

_log = logging.getLogger(__name__)


def with_settled_device(job: GeotagJob) -> GeotagJob:
    """Return a job whose networks, if it has any, run on ``cpu`` or ``cuda``, not ``auto``."""
    if job.spec.weights is WeightsUse.NONE:
        return job
    device = choose_device(job.config.device)
    _log.info("networks run on %s", device)
    return replace(job, config=replace(job.config, device=device))


def open_base(
    job: GeotagJob, symmetries: int | None = None, *, second_scale: bool = False
) -> Estimator:
    """Load the estimator; on a second scale one orientation is enough.

    Raises:
        WeightsError: the weights cannot be used.
        MissingExtraError: the estimator needs an optional package that is not installed.
    """
    config = job.config
    return open_estimator(
        config.estimator,
        weights=job.base_weights,
        device=config.device,
        symmetries=symmetries or config.symmetries,
        ensemble=config.ensemble,
        ue_iterations=config.ue_iterations,
        second_scale=second_scale,
    )


def refine_symmetries(job: GeotagJob, *, is_finer: bool) -> int | None:
    """Return in how many orientations frames are refined; None for an estimator of one.

    On a grid no finer than the search's, a network's own bias to one side matters: seen upside down
    too, it cancels.
    """
    if not job.spec.has_symmetries:
        return None
    return 1 if is_finer else COARSE_REFINE_SYMMETRIES


def open_refine_estimator(job: GeotagJob, base: Estimator, *, is_finer: bool) -> Estimator:
    """Return what refines near a known place, on a finer grid than the search's or on the same.

    Raises:
        WeightsError: the weights cannot be used.
    """
    symmetries = refine_symmetries(job, is_finer=is_finer)
    return base if symmetries is None else open_base(job, symmetries=symmetries)


def open_members(job: GeotagJob) -> list[Estimator]:
    """Load the members that answer beside the base network.

    Raises:
        WeightsError: the weights cannot be used.
    """
    return [
        open_estimator(job.config.estimator, weights=(path,), device=job.config.device)
        for path in job.member_weights
    ]


def says_deviations(estimator: Estimator) -> bool:
    """Tell whether an estimator's network states its own deviations (Direct Modeling)."""
    return isinstance(estimator, SelfAssessor) and estimator.models_std


def settled_uncertainty(job: GeotagJob, base: Estimator) -> UncertaintyChoice:
    """Return how uncertainty is told, now that the base network is known.

    Raises:
        WeightsError: the method asked for needs a second head, which the weights lack.
    """
    try:
        return chosen_uncertainty(job, has_head=says_deviations(base))
    except ValueError as error:
        where = f"{job.weights[0]}: " if job.weights else ""
        raise WeightsError(f"{where}{error}; `uasthn train --dm` gives a second head") from error
