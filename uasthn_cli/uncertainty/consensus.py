"""Homography consensus: every view's answer carried back to the full frame (paper, eqs. 1-5)."""

import numpy as np

from uasthn_cli.geometry.corners import homography_from_corners, transform_points
from uasthn_cli.types import FloatArray, Spread
from uasthn_cli.uncertainty.methods import UncertaintyChoice, frame_corners, frame_std


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


def spread_of_frame(
    views: FloatArray,
    found: FloatArray,
    choice: UncertaintyChoice,
    *,
    members: FloatArray | None = None,
    modelled_std: FloatArray | None = None,
) -> Spread:
    """Return the consensus of one frame: aggregated corners and standard deviations (paper, eq. 6).

    ``views`` and ``found`` as in :func:`recover_corners`; ``members`` ``(M - 1, 4, 2)`` are the
    full frame's corners as further networks found them, ``modelled_std`` ``(4, 2)`` what the base
    network says of its own. The deviation is the unbiased one (N - 1), as in the authors'
    evaluation.

    Raises:
        DegenerateHomographyError: a view's corners do not define a homography.
        ValueError: Direct Modeling of a network that says nothing.
    """
    recovered = recover_corners(views, found)
    further = np.empty((0, 4, 2)) if members is None else members
    answers = np.full((1 + len(further), len(recovered), 4, 2), np.nan)
    answers[0], answers[1:, 0] = recovered, further
    return Spread(
        recovered_px=recovered,
        corners_px=frame_corners(answers, choice),
        std_px=frame_std(answers, modelled_std, choice),
    )
