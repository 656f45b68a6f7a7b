"""Accept or reject an answer, and say why."""

import math
from dataclasses import dataclass

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

_MOST_DECIMALS = 6


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why an answer is not to be trusted: the reason, and in one line what is missing."""

    reason: Reason
    detail: str


def scalar_uncertainty(std: FloatArray, rule: Rule) -> float:
    """Reduce eight standard deviations ``(4, 2)`` to the one that the rule compares.

    ``all`` rejects when every one exceeds the threshold, that is when the smallest does.
    """
    if rule is Rule.ALL:
        return float(std.min())
    return float(std.max() if rule is Rule.ANY else std.mean())


def impossible_corners(
    reference_px: FloatArray, corners_px: FloatArray, max_scale_error: float
) -> Rejection | None:
    """Return why corners ``(4, 2)`` cannot be right whatever else is known, or None.

    ``reference_px`` are the full frame's corners as the prior had their shape.
    """
    if not np.isfinite(corners_px).all() or not is_convex(corners_px):
        return Rejection(
            Reason.DEGENERATE_HOMOGRAPHY, "the corners found are those of no quadrilateral"
        )
    scale = math.sqrt(max(area_px(corners_px) / area_px(reference_px), 0.0))
    if abs(scale - 1) <= max_scale_error:
        return None
    nearest = 1 + math.copysign(max_scale_error, scale - 1)
    found, limit = told_apart(scale, nearest)
    bound = "at most" if scale > 1 else "at least"
    return Rejection(
        Reason.IMPLAUSIBLE_SCALE,
        f"the footprint is {found} times as wide as height and camera have it, {bound} {limit}",
    )


def rejection(
    uncertainty_m: float,
    confidence: float,
    risk: float,
    window_m: float,
    config: DecisionConfig,
    max_risk: float | None,
) -> Rejection | None:
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
        found, limit = told_apart(uncertainty_m, max_std_m)
        detail = f"frame and views disagree by {found} m, at most {limit} m"
        return Rejection(Reason.UNCERTAIN, detail)
    if min_confidence is not None and not confidence >= min_confidence:
        found, limit = told_apart(confidence, min_confidence)
        return Rejection(Reason.AMBIGUOUS, f"confidence {found} of {limit} needed")
    if max_risk is not None and not risk <= max_risk:
        found, limit = told_apart(risk, max_risk)
        return Rejection(Reason.RISKY, f"risk {found}, at most {limit}")
    return None


def told_apart(value: float, limit: float) -> tuple[str, str]:
    """Return two numbers in words, with as many decimals, two at least, as tell them apart."""
    if math.isnan(value):
        return "unknown", f"{limit:.2f}"
    decimals = 2
    while decimals < _MOST_DECIMALS and f"{value:.{decimals}f}" == f"{limit:.{decimals}f}":
        decimals += 1
    return f"{value:.{decimals}f}", f"{limit:.{decimals}f}"
