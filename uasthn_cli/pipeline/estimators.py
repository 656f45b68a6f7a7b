"""Open the networks of a run: the base network, and further members of its ensemble."""

from uasthn_cli.config import COARSE_REFINE_SYMMETRIES
from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.registry import open_estimator
from uasthn_cli.pipeline.job import GeotagJob, chosen_uncertainty
from uasthn_cli.seam import Estimator, SelfAssessor
from uasthn_cli.uncertainty.methods import UncertaintyChoice


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


def open_refine_estimator(job: GeotagJob, base: Estimator, *, is_finer: bool) -> Estimator:
    """Return what refines near a known place, on a finer grid than the search's or on the same.

    On a coarse grid a network's own lopsidedness matters: seen upside down too, it cancels.

    Raises:
        WeightsError: the weights cannot be used.
    """
    if not job.spec.has_symmetries:
        return base
    return open_base(job, symmetries=1 if is_finer else COARSE_REFINE_SYMMETRIES)


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
