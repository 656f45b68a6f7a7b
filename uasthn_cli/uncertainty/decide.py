"""Accept or reject an estimate, and say why."""

import math

import numpy as np

from uasthn_cli.config import RESIZED_WIDTH_PX, DecisionConfig, Rule
from uasthn_cli.geometry.corners import area_px, is_convex
from uasthn_cli.types import Decision, FloatArray, Reason


def scalar_uncertainty(std: FloatArray, rule: Rule) -> float:
    """Reduce eight standard deviations ``(4, 2)`` to the one that the rule compares.

    ``all`` rejects when every one exceeds the threshold, that is when the smallest does.
    """
    if rule is Rule.ALL:
        return float(std.min())
    return float(std.max() if rule is Rule.ANY else std.mean())


def decide(
    std_m: FloatArray,
    confidence: float,
    reference_px: FloatArray,
    corners_px: FloatArray,
    window_m: float,
    config: DecisionConfig,
) -> Decision:
    """Judge one estimate.

    ``std_m`` ``(4, 2)`` in metres; ``reference_px`` and ``corners_px`` ``(4, 2)`` the full frame's
    corners as the prior had their shape and as estimated; ``window_m`` the map window's width,
    which is W_R pixels wide for a threshold in pixels.
    """
    uncertainty_m = scalar_uncertainty(std_m, config.rule)
    limit_m = config.max_std_m
    if config.max_std_px is not None:
        limit_m = config.max_std_px * window_m / RESIZED_WIDTH_PX
    reason: Reason | None = None
    if not np.isfinite(corners_px).all() or not is_convex(corners_px):
        reason = Reason.DEGENERATE_HOMOGRAPHY
    elif abs(_scale(reference_px, corners_px) - 1) > config.max_scale_error:
        reason = Reason.IMPLAUSIBLE_SCALE
    elif not uncertainty_m <= limit_m:
        reason = Reason.UNCERTAIN
    elif not confidence >= config.min_confidence:
        reason = Reason.AMBIGUOUS
    return Decision(reason is None, uncertainty_m, reason)


def _scale(reference_px: FloatArray, corners_px: FloatArray) -> float:
    return math.sqrt(max(area_px(corners_px) / area_px(reference_px), 0.0))
