"""Corners ⇄ homography: the DLT, composition, and what must be refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    area_px,
    homography_from_corners,
    image_corners_px,
    is_convex,
    transform_points,
)
from uasthn_cli.types import FloatArray

WIDTH_PX, HEIGHT_PX = 64, 48

displacements = hnp.arrays(np.float64, (4, 2), elements=st.floats(-9.0, 9.0))
"""Small enough that the corners of a 64 × 48 image stay convex."""


def quadrilateral(displacement: FloatArray) -> FloatArray:
    return image_corners_px(WIDTH_PX, HEIGHT_PX) + displacement


@given(displacements, displacements)
def test_corners_are_mapped_onto_corners(da: FloatArray, db: FloatArray) -> None:
    a, b = quadrilateral(da), quadrilateral(db)
    H = homography_from_corners(a, b)
    np.testing.assert_allclose(transform_points(H, a), b, atol=1e-6)
    assert H[2, 2] == 1.0


@given(displacements)
def test_corners_of_a_homography_give_it_back(displacement: FloatArray) -> None:
    a = image_corners_px(WIDTH_PX, HEIGHT_PX)
    H = homography_from_corners(a, a + displacement)
    other = np.array([[3.0, 2.0], [50.0, 5.0], [1.0, 40.0], [60.0, 44.0]])
    again = homography_from_corners(other, transform_points(H, other))
    np.testing.assert_allclose(again, H, atol=1e-7)


@given(displacements, displacements)
def test_composition_maps_like_one_step_after_the_other(da: FloatArray, db: FloatArray) -> None:
    a = image_corners_px(WIDTH_PX, HEIGHT_PX)
    b, c = a + da, a + db
    H_a_b, H_b_c = homography_from_corners(a, b), homography_from_corners(b, c)
    points = np.array([[10.0, 7.5], [31.5, 23.5], [55.0, 40.0]])
    np.testing.assert_allclose(
        transform_points(H_b_c @ H_a_b, points),
        transform_points(H_b_c, transform_points(H_a_b, points)),
        atol=1e-6,
    )
    np.testing.assert_allclose(transform_points(H_b_c @ H_a_b, a), c, atol=1e-6)


@given(displacements, st.floats(-1e6, 1e6), st.floats(1e-3, 1e3))
def test_units_and_far_origins_do_not_cost_precision(
    displacement: FloatArray, far: float, unit: float
) -> None:
    a = image_corners_px(WIDTH_PX, HEIGHT_PX)
    b = (a + displacement) * unit + far
    mapped = transform_points(homography_from_corners(a, b), a)
    np.testing.assert_allclose(mapped, b, atol=1e-6 * unit + 1e-9 * abs(far))


def test_a_batch_is_solved_as_each_alone() -> None:
    rng = np.random.default_rng(0)
    a = image_corners_px(WIDTH_PX, HEIGHT_PX)
    b = a + rng.uniform(-9, 9, (3, 5, 4, 2))
    batch = homography_from_corners(a, b)
    assert batch.shape == (3, 5, 3, 3)
    np.testing.assert_allclose(batch[2, 1], homography_from_corners(a, b[2, 1]), atol=1e-12)
    np.testing.assert_allclose(transform_points(batch, a), b, atol=1e-8)


def test_convention_corners_are_pixel_centres_in_reading_order() -> None:
    corners = image_corners_px(64, 48)
    np.testing.assert_array_equal(corners, [[0, 0], [63, 0], [0, 47], [63, 47]])


@pytest.mark.parametrize("side", ["from", "to"])
def test_three_corners_on_a_line_are_refused(side: str) -> None:
    good = image_corners_px(WIDTH_PX, HEIGHT_PX)
    flat = np.array([[0.0, 0.0], [63.0, 0.0], [0.0, 47.0], [31.5, 23.5]])
    pair = (flat, good) if side == "from" else (good, flat)
    with pytest.raises(DegenerateHomographyError, match="one line"):
        homography_from_corners(*pair)


def test_coinciding_and_infinite_corners_are_refused() -> None:
    good = image_corners_px(WIDTH_PX, HEIGHT_PX)
    with pytest.raises(DegenerateHomographyError, match="coincide"):
        homography_from_corners(good, np.zeros((4, 2)))
    with pytest.raises(DegenerateHomographyError, match="finite"):
        homography_from_corners(good, np.where(good > 60, np.nan, good))


def test_a_horizon_through_the_middle_or_the_origin_is_refused() -> None:
    good = image_corners_px(WIDTH_PX, HEIGHT_PX)
    with pytest.raises(DegenerateHomographyError, match="infinity"):
        homography_from_corners(good, good[[0, 1, 3, 2]])
    H_vanishing_origin = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 2.0], [0.01, 0.02, 0.0]])
    away = good + 20.0
    with pytest.raises(DegenerateHomographyError, match="origin"):
        homography_from_corners(away, transform_points(H_vanishing_origin, away))


def test_one_bad_quadrilateral_spoils_no_check_of_a_batch() -> None:
    good = image_corners_px(WIDTH_PX, HEIGHT_PX)
    bad = good.copy()
    bad[3] = bad[0]
    with pytest.raises(DegenerateHomographyError):
        homography_from_corners(good, np.stack([good, bad]))


@given(displacements)
def test_displaced_corners_stay_convex_and_keep_their_area(displacement: FloatArray) -> None:
    corners = quadrilateral(displacement)
    assert is_convex(corners)
    assert area_px(corners) > 0
    mirrored = corners[[1, 0, 3, 2]]
    assert not is_convex(mirrored)
    assert area_px(mirrored) == pytest.approx(-area_px(corners))


def test_area_and_convexity_of_known_shapes() -> None:
    assert area_px(image_corners_px(64, 48)) == pytest.approx(63 * 47)
    dent = np.array([[0.0, 0.0], [63.0, 0.0], [0.0, 47.0], [20.0, 10.0]])
    assert not is_convex(dent)
    bow_tie = image_corners_px(64, 48)[[0, 1, 3, 2]]
    assert not is_convex(bow_tie)
