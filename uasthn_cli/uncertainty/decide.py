"""Accept or reject an answer, and say why."""

import math

import numpy as np

from uasthn_cli.config import (
    FALLBACK_MAX_STD_M,
    FALLBACK_MIN_CONFIDENCE,
    RESIZED_WIDTH_PX,
    DecisionConfig,
    Rule,
)
from uasthn_cli.geometry.corners import area_px, is_convex
from uasthn_cli.types import FloatArray, Reason


def scalar_uncertainty(std: FloatArray, rule: Rule) -> float:
    """Reduce eight standard deviations ``(4, 2)`` to the one that the rule compares.

    ``all`` rejects when every one exceeds the threshold, that is when the smallest does.
    """
    if rule is Rule.ALL:
        return float(std.min())
    return float(std.max() if rule is Rule.ANY else std.mean())


def impossible_corners(
    reference_px: FloatArray, corners_px: FloatArray, max_scale_error: float
) -> Reason | None:
    """Return why corners ``(4, 2)`` cannot be right whatever else is known, or None.

    ``reference_px`` are the full frame's corners as the prior had their shape.
    """
    if not np.isfinite(corners_px).all() or not is_convex(corners_px):
        return Reason.DEGENERATE_HOMOGRAPHY
    scale = math.sqrt(max(area_px(corners_px) / area_px(reference_px), 0.0))
    return Reason.IMPLAUSIBLE_SCALE if abs(scale - 1) > max_scale_error else None


def rejection_reason(
    uncertainty_m: float,
    confidence: float,
    risk: float,
    window_m: float,
    config: DecisionConfig,
    max_risk: float | None,
) -> Reason | None:
    """Return why an answer is not to be trusted, or None.

    ``max_risk`` is the calibration's limit on ``risk``; without one (None) the fallbacks apply
    where the user gave no limits. ``window_m`` is the map window's width, which is W_R pixels wide
    for a threshold in pixels.
    """
    max_std_m, min_confidence = config.max_std_m, config.min_confidence
    if config.max_std_px is not None:
        max_std_m = config.max_std_px * window_m / RESIZED_WIDTH_PX
    if max_risk is None:
        max_std_m = FALLBACK_MAX_STD_M if max_std_m is None else max_std_m
        min_confidence = FALLBACK_MIN_CONFIDENCE if min_confidence is None else min_confidence
    if max_std_m is not None and not uncertainty_m <= max_std_m:
        return Reason.UNCERTAIN
    if min_confidence is not None and not confidence >= min_confidence:
        return Reason.AMBIGUOUS
    if max_risk is not None and not risk <= max_risk:
        return Reason.RISKY
    return None
