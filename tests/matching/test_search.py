"""Peaks, their sub-cell place, belief in them, and which cells belong to a view."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.matching.search import best_shift, posterior_mass, view_masks, within_reach
from uasthn_cli.types import FloatArray

ROWS, COLUMNS = 9, 14


def bowl(x: float, y: float, bend_x: float, bend_y: float) -> FloatArray:
    """Return scores whose true peak is at ``(x, y)``."""
    rows, columns = np.mgrid[:ROWS, :COLUMNS].astype(float)
    scores: FloatArray = -bend_x * (columns - x) ** 2 - bend_y * (rows - y) ** 2
    return scores


@given(
    x=st.floats(1.0, COLUMNS - 2.0),
    y=st.floats(1.0, ROWS - 2.0),
    bend_x=st.floats(0.01, 5.0),
    bend_y=st.floats(0.01, 5.0),
)
def test_convention_the_peak_of_a_parabola_is_found_exactly(
    x: float, y: float, bend_x: float, bend_y: float
) -> None:
    assert best_shift(bowl(x, y, bend_x, bend_y)) == pytest.approx([x, y], abs=1e-6)


@pytest.mark.parametrize(("x", "y"), [(0, 4), (COLUMNS - 1, 4), (6, 0), (6, ROWS - 1)])
def test_a_peak_on_the_edge_stays_on_its_cell(x: int, y: int) -> None:
    assert best_shift(bowl(x, y, 1.0, 1.0)) == pytest.approx([x, y])


def test_a_neighbour_that_does_not_count_leaves_the_cell_as_it_is() -> None:
    scores = bowl(5.3, 4.2, 1.0, 1.0)
    scores[:, 6:] = -np.inf
    assert best_shift(scores) == pytest.approx([5.0, 4.2])


def test_a_plateau_is_not_divided_by_zero() -> None:
    assert np.isfinite(best_shift(np.zeros((ROWS, COLUMNS)))).all()


def test_without_any_admissible_shift_the_answer_is_finite() -> None:
    assert np.isfinite(best_shift(np.full((ROWS, COLUMNS), -np.inf))).all()


def test_without_any_admissible_shift_the_given_one_is_the_answer() -> None:
    prior_shift = np.array([4.25, 3.5])
    nowhere = np.full((ROWS, COLUMNS), -np.inf)
    assert best_shift(nowhere, otherwise=prior_shift) == pytest.approx(prior_shift)
    assert best_shift(bowl(7.0, 2.0, 1.0, 1.0), otherwise=prior_shift) == pytest.approx([7.0, 2.0])


def test_two_equal_peaks_far_apart_share_the_belief() -> None:
    scores = np.full((60, 80), -np.inf)
    scores[10, 10] = scores[50, 70] = 7.0
    assert posterior_mass(scores, np.array([10.0, 10.0]), cell_m=4.0) == pytest.approx(0.5)


def test_peaks_within_the_tolerance_of_25_m_count_together() -> None:
    scores = np.full((60, 80), -np.inf)
    scores[10, 10] = scores[10, 16] = scores[10, 17] = 1.0
    assert posterior_mass(scores, np.array([10.0, 10.0]), cell_m=4.0) == pytest.approx(2 / 3)


def test_on_coarse_cells_the_tolerance_is_three_of_them() -> None:
    scores = np.full((60, 80), -np.inf)
    scores[10, 10] = scores[10, 13] = scores[10, 14] = 1.0
    assert posterior_mass(scores, np.array([10.0, 10.0]), cell_m=50.0) == pytest.approx(2 / 3)


def test_belief_is_the_soft_max_of_the_scores() -> None:
    scores = np.full((60, 80), -np.inf)
    scores[10, 10], scores[50, 70] = 800.0, 800.0 - math.log(3.0)
    assert posterior_mass(scores, np.array([10.0, 10.0]), cell_m=4.0) == pytest.approx(0.75)


def test_no_admissible_shift_no_belief() -> None:
    assert posterior_mass(np.full((4, 5), -np.inf), np.zeros(2), cell_m=4.0) == 0.0


def test_convention_the_full_view_holds_every_cell() -> None:
    valid = np.ones((12, 20), np.bool_)
    assert view_masks(image_corners_px(20, 12)[None], valid, 1).all()
    assert view_masks(image_corners_px(40, 24)[None], valid, 2).all()


def test_convention_a_view_holds_the_cells_that_lie_in_it() -> None:
    left_px, top_px, right_px, bottom_px = 4.0, 6.0, 25.0, 17.0
    view = np.array([[left_px, top_px], [right_px, top_px], [left_px, bottom_px], [25.0, 17.0]])
    (mask,) = view_masks(view[None], np.ones((12, 20), np.bool_), 2)
    expected = np.zeros((12, 20), np.bool_)
    expected[3:9, 2:13] = True  # cell (row, column) is centred on pixel (2 column + 0.5, ...)
    assert (mask.astype(bool) == expected).all()


def test_a_turned_view_covers_its_area() -> None:
    view = np.array([[50.0, 5.0], [95.0, 40.0], [20.0, 45.0], [65.0, 80.0]])
    (mask,) = view_masks(view[None], np.ones((90, 110), np.bool_), 1)
    u, v = view[1] - view[0], view[2] - view[0]
    assert mask.sum() == pytest.approx(abs(u[0] * v[1] - u[1] * v[0]), rel=0.05)
    assert mask[42, 57]
    assert not mask[10, 90]


def test_views_leave_out_what_the_frame_does_not_show() -> None:
    valid = np.ones((12, 20), np.bool_)
    valid[:, 15:] = False
    (mask,) = view_masks(image_corners_px(20, 12)[None], valid, 1)
    assert (mask.astype(bool) == valid).all()


def test_each_view_has_its_own_mask() -> None:
    views = np.stack([image_corners_px(20, 12), image_corners_px(10, 6)])
    full, crop = view_masks(views, np.ones((12, 20), np.bool_), 1)
    assert full.sum() == 240
    assert crop.sum() == 60


def test_nothing_beyond_the_reach_of_the_window_is_searched() -> None:
    near = within_reach((21, 31), np.array([15.0, 10.0]))
    rows, columns = np.nonzero(near)
    assert np.hypot(columns - 15, rows - 10).max() <= 10.0
    assert near[0, 15]
    assert near[20, 15]
    assert not near[0, 0]
    assert near.sum() == pytest.approx(math.pi * 100, rel=0.05)


def test_reach_is_measured_from_the_prior() -> None:
    near = within_reach((21, 31), np.array([4.25, 12.0]))
    rows, columns = np.nonzero(near)
    assert np.hypot(columns - 4.25, rows - 12).max() <= 4.25
    assert near[12, 0]
