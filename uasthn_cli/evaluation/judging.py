"""From predictions to errors and uncertainties, by method of uncertainty estimation."""

from dataclasses import dataclass, field

import numpy as np

from uasthn_cli.config import (
    FALLBACK_MAX_STD_M,
    RESIZED_WIDTH_PX,
    Aggregation,
    DecisionConfig,
    Merge,
    UeMethod,
)
from uasthn_cli.errors import PredictionsError
from uasthn_cli.evaluation.predictions import Predictions
from uasthn_cli.matching.registry import has_ensemble
from uasthn_cli.types import BoolArray, FloatArray
from uasthn_cli.uncertainty import methods
from uasthn_cli.uncertainty.decide import scalar_uncertainty
from uasthn_cli.uncertainty.methods import Offer, UncertaintyChoice


@dataclass(frozen=True, slots=True)
class JudgingConfig:
    """When an answer is rejected, and what it is.

    ``decision`` gives threshold s_c and rule; without a threshold it is 10 m. ``aggregation`` None:
    the paper's choice for each method.
    """

    decision: DecisionConfig = field(default_factory=DecisionConfig)
    merge: Merge = Merge.MAX
    aggregation: Aggregation | None = None


@dataclass(frozen=True, slots=True)
class Judged:
    """Answers ``(n,)`` of one method: errors, uncertainty, and what the threshold accepts.

    A sample without an answer has the prior's error, infinite uncertainty, and is not accepted
    by any method that can reject.
    """

    mace_m: FloatArray
    ce_m: FloatArray
    uncertainty_m: FloatArray
    accepted: BoolArray
    answered: BoolArray


def refusal(predictions: Predictions, method: UeMethod) -> str | None:
    """Return why a method cannot be had from these predictions, or None."""
    offer = Offer(
        estimator=predictions.settings.estimator,
        views=predictions.views,
        members=predictions.members,
        has_head=bool(np.isfinite(predictions.modelled_std_px).any()),
        has_box_ensemble=has_ensemble(predictions.settings.estimator),
    )
    return methods.refusal(method, offer)


def judge(predictions: Predictions, method: UeMethod, config: JudgingConfig) -> Judged:
    """Return errors and uncertainties by one method.

    Raises:
        PredictionsError: the predictions lack what the method needs.
    """
    why = refusal(predictions, method)
    if why is not None:
        raise PredictionsError(why)
    aggregation = config.aggregation or methods.paper_aggregation(method)
    choice = UncertaintyChoice(method, config.merge, aggregation)
    corners_px = methods.frame_corners(predictions.answers_px, choice)
    std_px = methods.frame_std(predictions.answers_px, predictions.modelled_std_px, choice)
    std_m = std_px * predictions.gsd_m[:, None, None]
    answered = np.asarray(np.isfinite(corners_px).all(axis=(1, 2)))
    corners_px = np.where(answered[:, None, None], corners_px, predictions.prior_px)
    rule = config.decision.rule
    uncertainty_m = np.array([scalar_uncertainty(std, rule) for std in std_m])
    uncertainty_m = np.where(answered & np.isfinite(uncertainty_m), uncertainty_m, np.inf)
    accepted = uncertainty_m <= _max_std_m(predictions, config.decision)
    if method is UeMethod.NONE:
        accepted = np.ones(len(predictions), np.bool_)
    return Judged(
        mace_m=mean_corner_errors_m(corners_px, predictions.true_px, predictions.gsd_m),
        ce_m=centre_errors_m(corners_px, predictions.true_px, predictions.gsd_m),
        uncertainty_m=uncertainty_m,
        accepted=accepted,
        answered=answered,
    )


def mean_corner_errors_m(
    found_px: FloatArray, true_px: FloatArray, gsd_m: FloatArray
) -> FloatArray:
    """Return MACE ``(n,)``: the mean distance of four found and true corners ``(n, 4, 2)``."""
    return np.asarray(np.linalg.norm(found_px - true_px, axis=-1).mean(axis=-1) * gsd_m)


def centre_errors_m(found_px: FloatArray, true_px: FloatArray, gsd_m: FloatArray) -> FloatArray:
    """Return CE ``(n,)``: the distance of found and true centres of ``(n, 4, 2)``."""
    distance_px = np.linalg.norm(image_centres_px(found_px) - image_centres_px(true_px), axis=-1)
    return np.asarray(distance_px * gsd_m)


def image_centres_px(corners_px: FloatArray) -> FloatArray:
    """Return where the image's centre lies ``(n, 2)``: where the diagonals meet.

    Any homography keeps that; where corners are so wrong that diagonals are parallel, their mean.
    """
    top_left, top_right, bottom_left, bottom_right = np.moveaxis(corners_px, -2, 0)
    down, up = bottom_right - top_left, top_right - bottom_left
    across = down[..., 0] * up[..., 1] - down[..., 1] * up[..., 0]
    gap = bottom_left - top_left
    parallel = np.abs(across) < 1e-9
    share = (gap[..., 0] * up[..., 1] - gap[..., 1] * up[..., 0]) / np.where(parallel, 1.0, across)
    meeting = top_left + share[..., None] * down
    return np.asarray(np.where(parallel[..., None], corners_px.mean(axis=-2), meeting))


def _max_std_m(predictions: Predictions, decision: DecisionConfig) -> FloatArray:
    """Return the threshold of each sample ``(n,)``; pixels are those of W_R across the window."""
    if decision.max_std_px is not None:
        window_m = predictions.satellite_px * predictions.gsd_m
        return np.asarray(decision.max_std_px * window_m / RESIZED_WIDTH_PX)
    limit_m = FALLBACK_MAX_STD_M if decision.max_std_m is None else decision.max_std_m
    return np.full(len(predictions), limit_m)
