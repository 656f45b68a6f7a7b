"""Rivals get a fair hearing: each finds what it can find in principle."""

import numpy as np
import pytest
from matching_scene import centred_origin, encoded, full_view, map_window, thermal_cut
from posed_flight import POSES, PosedFlight, make_posed_flight, opened
from rivals import PriorEstimator, SiftEstimator
from small_flight import ground_texture

from uasthn_cli.geometry.corners import DegenerateHomographyError
from uasthn_cli.types import Estimator, Fix, FrameFailure, FrameResult, Reason

GREY = ground_texture(3)
CORNER_PX, SIZE_PX = (120, 90), (160, 128)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> PosedFlight:
    return make_posed_flight(tmp_path_factory.mktemp("posed"), POSES[:2])


def results_of(flight: PosedFlight, estimator: Estimator) -> list[FrameResult]:
    with opened(flight, estimator, gsd_m=1.0) as run:
        return list(run.results())


def test_sift_finds_what_looks_alike() -> None:
    estimator, window = SiftEstimator(), map_window(GREY)
    thermal = thermal_cut(0.5 * GREY + 40.0, CORNER_PX, SIZE_PX)
    views = np.concatenate([full_view(thermal), full_view(thermal)])
    views[1, [1, 3], 0] -= 30.0
    origin = centred_origin(window, thermal)
    estimate = estimator.estimate(encoded(estimator, window), thermal, views, origin)
    assert estimate.corners_px[-1] == pytest.approx(views + CORNER_PX, abs=0.5)


def test_sift_does_not_find_an_inverted_picture() -> None:
    estimator, window = SiftEstimator(), map_window(GREY)
    thermal = thermal_cut(255.0 - GREY, CORNER_PX, SIZE_PX)
    with pytest.raises(DegenerateHomographyError, match="matches give no homography"):
        estimator.estimate(
            encoded(estimator, window),
            thermal,
            full_view(thermal),
            centred_origin(window, thermal),
        )


def test_a_frame_without_matches_becomes_a_row(flight: PosedFlight) -> None:
    class Blind(SiftEstimator):
        def _keypoints(self, *_: object) -> tuple[np.ndarray, np.ndarray]:
            return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)

    for result in results_of(flight, Blind()):
        assert isinstance(result, FrameFailure)
        assert result.reason is Reason.DEGENERATE_HOMOGRAPHY


def test_the_prior_stays_where_it_is(flight: PosedFlight) -> None:
    for result in results_of(flight, PriorEstimator()):
        assert isinstance(result, Fix)
        assert result.offset_m == pytest.approx(0.0, abs=1e-3)
