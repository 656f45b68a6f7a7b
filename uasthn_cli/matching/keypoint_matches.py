"""From matched keypoints to an estimate: a homography for every view."""

import cv2
import numpy as np

from uasthn_cli.geometry.corners import DegenerateHomographyError, transform_points
from uasthn_cli.matching.search import within_reach
from uasthn_cli.seam import Estimate
from uasthn_cli.types import BoolArray, FloatArray, MapFeatures, Ortho

Matches = tuple[FloatArray, FloatArray]
"""The same points ``(n, 2)`` in the ortho and in the window."""

_REPROJECTION_PX = 3.0
_MAGSAC_ITERATIONS = 10_000
_MAGSAC_CONFIDENCE = 0.999
_MIN_INLIERS = 6

_INLIER_IF_RIGHT, _INLIER_IF_WRONG, _PRIOR_RIGHT = 0.6, 0.1, 1e-6
"""Brown & Lowe, "Automatic Panoramic Image Stitching using Invariant Features" (2007), sec. 3.2."""


def estimate_from_matches(
    features: MapFeatures,
    thermal: Ortho,
    views_px: FloatArray,
    origin_px: FloatArray,
    matches: Matches,
) -> Estimate:
    """Return the corners of views ``(N, 4, 2)`` by MAGSAC++ on the matches inside each.

    Matches that join what is not valid, or imply a shift beyond the search radius, do not count. A
    view without a homography answers with the prior, so that views disagree. Confidence is
    :func:`match_belief` of the first view. MAGSAC++: Barath et al. 2020, by OpenCV.

    Raises:
        DegenerateHomographyError: the first view's matches give no homography.
    """
    from_px, to_px = (
        places[_plausible(features, thermal, origin_px, matches)] for places in matches
    )
    corners, confidence = views_px + origin_px, 0.0
    for index, view in enumerate(views_px):
        inside = _inside(view, from_px)
        found, inliers = _locate(view, from_px[inside], to_px[inside])
        if index == 0:
            if found is None:
                raise DegenerateHomographyError(f"{inside.sum()} matches give no homography")
            confidence = match_belief(inliers, int(inside.sum()))
        if found is not None:
            corners[index] = found
    return Estimate(corners, confidence)


def match_belief(inliers: int, matches: int) -> float:
    """Return the probability that a homography is right, by how many of its matches agree with it.

    Brown & Lowe's test of binomials: a match agrees with a right homography with probability 0.6,
    with a wrong one with 0.1, and one of a million is right to begin with. Half-way lies at about
    5.3 inliers and 0.31 more for every match.
    """
    outliers = matches - inliers
    log_odds = (
        np.log(_PRIOR_RIGHT / (1.0 - _PRIOR_RIGHT))
        + inliers * np.log(_INLIER_IF_RIGHT / _INLIER_IF_WRONG)
        + outliers * np.log((1.0 - _INLIER_IF_RIGHT) / (1.0 - _INLIER_IF_WRONG))
    )
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -500.0, 500.0))))


def _plausible(
    features: MapFeatures, thermal: Ortho, origin_px: FloatArray, matches: Matches
) -> BoolArray:
    """Return which matches join valid pixels at a shift within the search radius."""
    from_px, to_px = matches
    rows, columns = (
        n - m + 1 for n, m in zip(features.valid.shape, thermal.valid.shape, strict=True)
    )
    reach = within_reach((rows, columns), origin_px)
    plausible: BoolArray = (
        _holds_at(thermal.valid, from_px)
        & _holds_at(features.valid, to_px)
        & _holds_at(reach, to_px - from_px)
    )
    return plausible


def _holds_at(mask: BoolArray, points_px: FloatArray) -> BoolArray:
    """Return whether ``mask`` ``(h, w)`` holds at points ``(n, 2)``; false outside of it."""
    x, y = np.floor(points_px + 0.5).astype(int).T
    rows, columns = mask.shape
    holds: BoolArray = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    holds[holds] = mask[y[holds], x[holds]]
    return holds


def _inside(view: FloatArray, points_px: FloatArray) -> BoolArray:
    """Return which points ``(n, 2)`` lie in the convex quadrilateral of a view's corners."""
    ring = view[[0, 1, 3, 2]]
    edges = np.roll(ring, -1, axis=0) - ring
    to_points = points_px[:, None] - ring
    cross = edges[:, 0] * to_points[..., 1] - edges[:, 1] * to_points[..., 0]
    inside: BoolArray = np.logical_and.reduce(cross >= 0.0, axis=1)
    return inside


def _locate(
    view: FloatArray, from_px: FloatArray, to_px: FloatArray
) -> tuple[FloatArray | None, int]:
    """Return a view's corners ``(4, 2)``, or None, and how many matches agree on them."""
    if len(from_px) < _MIN_INLIERS:
        return None, 0
    H, agreeing = cv2.findHomography(
        from_px,
        to_px,
        cv2.USAC_MAGSAC,
        _REPROJECTION_PX,
        maxIters=_MAGSAC_ITERATIONS,
        confidence=_MAGSAC_CONFIDENCE,
    )
    inliers = 0 if H is None else int(np.sum(agreeing))
    if inliers < _MIN_INLIERS:
        return None, inliers
    corners = transform_points(np.asarray(H, np.float64), view)
    return (corners if np.isfinite(corners).all() else None), inliers
