"""Homography consensus: every view's answer carried back to the full frame (paper, eqs. 1-5)."""

import numpy as np

from uasthn_cli.config import Aggregation
from uasthn_cli.geometry.corners import homography_from_corners, transform_points
from uasthn_cli.types import FloatArray, Spread


def recover_corners(views: FloatArray, found: FloatArray) -> FloatArray:
    """Return the full frame's corners ``(N, 4, 2)`` as each of N views implies them.

    ``views`` ``(N, 4, 2)`` are the views' corners before, ``found`` after the estimated homography;
    view 0 is the full frame. All views share the frame's homography, so that of view i applied to
    the full frame's corners gives where they lie.

    Raises:
        DegenerateHomographyError: a view's corners do not define a homography.
    """
    H_views = homography_from_corners(views, found)
    return transform_points(H_views, np.broadcast_to(views[0], views.shape))


def spread_of_views(views: FloatArray, found: FloatArray, aggregation: Aggregation) -> Spread:
    """Return the consensus of N views: aggregated corners and standard deviations (paper, eq. 6).

    The deviation is the unbiased one (N - 1), as in the authors' evaluation.

    Raises:
        DegenerateHomographyError: a view's corners do not define a homography.
    """
    recovered = recover_corners(views, found)
    std = recovered.std(axis=0, ddof=1) if len(recovered) > 1 else np.zeros((4, 2))
    if aggregation is Aggregation.MEAN:
        return Spread(recovered, recovered.mean(axis=0), std)
    return Spread(recovered, recovered[0], std)
