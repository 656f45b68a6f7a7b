"""Keypoints get a fair hearing: each kind finds what it can find in principle."""

from collections.abc import Callable
from pathlib import Path

import cv2
import keypoints
import numpy as np
import pytest
from keypoints import KeypointEstimator, Keypoints, akaze_magsac, has_akaze, sift_magsac
from matching_scene import centred_origin, encoded, full_view, map_window, thermal_cut
from posed_flight import POSES, alone, make_posed_flight, opened
from small_flight import ground_texture

from uasthn_cli.types import FrameFailure, Reason

GREY = ground_texture(3)
CORNER_PX, SIZE_PX = (120, 90), (160, 128)


def orb_magsac() -> KeypointEstimator:
    """Return a binary descriptor that every OpenCV has."""
    return KeypointEstimator("orb-magsac", cv2.ORB.create(nfeatures=3000), cv2.NORM_HAMMING)


needs_akaze = pytest.mark.skipif(not has_akaze(), reason="this OpenCV has no AKAZE")


@pytest.mark.parametrize(
    "make", [sift_magsac, orb_magsac, pytest.param(akaze_magsac, marks=needs_akaze)]
)
@pytest.mark.parametrize("gain", [0.5, -0.5])
def test_keypoints_find_a_cut_out_of_either_contrast(
    make: Callable[[], KeypointEstimator], gain: float
) -> None:
    estimator, window = make(), map_window(GREY)
    thermal = thermal_cut(128.0 + gain * (GREY - 128.0), CORNER_PX, SIZE_PX)
    views = np.concatenate([full_view(thermal), full_view(thermal)])
    views[1, [1, 3], 0] -= 30.0
    origin = centred_origin(window, thermal)
    estimate = estimator.estimate(encoded(estimator, window), thermal, views, origin)
    assert estimate.corners_px == pytest.approx(views + CORNER_PX, abs=0.7)
    assert estimate.confidence == 1.0


def test_a_frame_without_keypoints_becomes_a_row(tmp_path: Path) -> None:
    class Blind(KeypointEstimator):
        def _keypoints(self, *_: object) -> Keypoints:
            return keypoints._NOTHING

    flight = make_posed_flight(tmp_path / "posed", POSES[:2])
    with opened(flight, Blind("blind", cv2.SIFT.create(), cv2.NORM_L2), gsd_m=1.0) as run:
        for result in alone(run):
            assert isinstance(result, FrameFailure)
            assert result.reason is Reason.DEGENERATE_HOMOGRAPHY
