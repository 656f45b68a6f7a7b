import numpy as np
import pytest
from known_estimator import KnownPairs

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.evaluation.canvas import place_pair, prior_corners_px
from uasthn_cli.geometry.corners import transform_points


@pytest.mark.parametrize("width_px", [None, 48, 31, 20, 400])
def test_convention_middles_stay_middles_and_points_go_there_and_back(
    width_px: int | None,
) -> None:
    sample = KnownPairs(((11.0, -7.0),))[0]
    placed = place_pair(sample, width_px)
    side_px, ortho_px = placed.window.valid.shape[0], placed.thermal.valid.shape[0]
    assert side_px % 16 == ortho_px % 16 == 0
    middle = transform_points(placed.H_satellite_window, np.full((1, 2), 159 / 2))
    np.testing.assert_allclose(middle, np.full((1, 2), (side_px - 1) / 2))
    np.testing.assert_allclose(placed.thermal.nadir_px + placed.origin_px, middle[0])
    points = np.array([[3.0, 100.0], [70.0, 2.5]])
    there = transform_points(placed.H_satellite_window, points)
    np.testing.assert_allclose(placed.to_satellite(there), points)
    # one step on either canvas is as many metres
    for H in (placed.H_satellite_window, placed.thermal.H_frame_ortho):
        assert H[0, 0] * placed.window.grid.gsd_m == pytest.approx(sample.satellite_gsd_m)


def test_convention_a_prior_that_is_right_is_the_origin() -> None:
    sample = KnownPairs(((0.0, 0.0),))[0]
    placed = place_pair(sample, 31)
    np.testing.assert_allclose(prior_corners_px(sample), sample.corners_px)
    ortho_px = transform_points(placed.thermal.H_frame_ortho, np.zeros((1, 2)))
    found_px = placed.to_satellite(ortho_px + placed.origin_px)
    np.testing.assert_allclose(found_px[0], sample.corners_px[0])


def test_pixels_stay_as_they_are_without_a_width() -> None:
    sample = KnownPairs(((0.0, 0.0),))[0]
    placed = place_pair(sample, None)
    assert placed.thermal.valid.all()
    np.testing.assert_allclose(placed.thermal.image * 255, sample.thermal, atol=1e-3)
    np.testing.assert_allclose(placed.window.image * 255, sample.satellite, atol=1e-3)


def test_black_is_no_data_and_has_no_part_in_the_statistics() -> None:
    whole = KnownPairs(((0.0, 0.0),))[0]
    satellite = np.full_like(whole.satellite, 51)
    satellite[:, :40] = 0
    sample = MatchSample("edge", satellite, whole.thermal, whole.corners_px, 2.0)
    placed = place_pair(sample, None)
    assert not placed.window.valid[:, :40].any()
    assert placed.window.valid[:, 40:].all()
    np.testing.assert_allclose(placed.window.statistics.mean, 0.2, atol=1e-6)
