"""Matches become corners: exactly where they are right, and not at all where they are not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matching_scene import GSD_M

from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    homography_from_corners,
    image_corners_px,
    transform_points,
)
from uasthn_cli.matching.keypoint_matches import Matches, estimate_from_matches, match_belief
from uasthn_cli.seam import Estimate
from uasthn_cli.types import FloatArray, GridBox, MapFeatures, MapGrid, Ortho

WIDTH_PX, HEIGHT_PX, REACH_PX = 96, 80, 64
VIEW = image_corners_px(WIDTH_PX, HEIGHT_PX)
LEFT, RIGHT = VIEW.copy(), VIEW.copy()
LEFT[[1, 3], 0], RIGHT[[0, 2], 0] = 47.0, 48.0
VIEWS = np.stack([VIEW, LEFT, RIGHT])
ORIGIN = np.array([REACH_PX, REACH_PX], np.float64)
GRID = np.mgrid[2:94:7, 2:78:7].reshape(2, -1).T.astype(np.float64)


def located(matches: Matches, *, map_ends_px: int | None = None) -> Estimate:
    valid = np.ones((HEIGHT_PX + 2 * REACH_PX, WIDTH_PX + 2 * REACH_PX), np.bool_)
    valid[:, map_ends_px:] = map_ends_px is None
    box = GridBox(0, 0, valid.shape[1], valid.shape[0])
    features = MapFeatures(valid[None].astype(np.float32), valid, box, MapGrid(GSD_M), 1)
    seen = np.ones((HEIGHT_PX, WIDTH_PX), np.bool_)
    thermal = Ortho(seen.astype(np.float32), seen, GSD_M, np.eye(3), np.zeros(2))
    return estimate_from_matches(features, thermal, VIEWS, ORIGIN, matches)


def corners_near_the_prior() -> st.SearchStrategy[FloatArray]:
    shifts = st.tuples(st.floats(-40, 40), st.floats(-40, 40))
    jitter = st.lists(st.floats(-4, 4), min_size=8, max_size=8)
    return st.tuples(shifts, jitter).map(
        lambda drawn: VIEW + ORIGIN + np.array(drawn[0]) + np.reshape(drawn[1], (4, 2))
    )


@given(corners_near_the_prior(), st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_a_homography_is_found_among_wrong_matches(corners: FloatArray, seed: int) -> None:
    H = homography_from_corners(VIEW, corners)
    wrong = np.random.default_rng(seed).uniform(0, [WIDTH_PX, HEIGHT_PX], (2, 40, 2))
    from_px = np.concatenate([GRID, wrong[0]])
    to_px = np.concatenate([transform_points(H, GRID), wrong[1] + ORIGIN])
    estimate = located((from_px, to_px))
    for view, found in zip(VIEWS, estimate.corners_px, strict=True):
        # a wrong match may by chance lie within the few pixels that count, and pull a little
        assert found == pytest.approx(transform_points(H, view), abs=0.5)
    assert estimate.confidence > 0.99


def test_every_view_goes_by_the_matches_inside_it() -> None:
    shift = np.where(GRID[:, :1] < 47.5, [[10.0, 5.0]], [[-12.0, 20.0]])
    estimate = located((GRID, GRID + ORIGIN + shift))
    left, right = estimate.corners_px[1:] - VIEWS[1:] - ORIGIN
    assert left == pytest.approx(np.tile([10.0, 5.0], (4, 1)), abs=0.01)
    assert right == pytest.approx(np.tile([-12.0, 20.0], (4, 1)), abs=0.01)


def test_a_view_without_matches_stays_at_the_prior() -> None:
    left_only = GRID[GRID[:, 0] < 47.5]
    found = located((left_only, left_only + ORIGIN + 7.0)).corners_px
    assert found[1] == pytest.approx(LEFT + ORIGIN + 7.0, abs=0.01)
    assert found[2] == pytest.approx(RIGHT + ORIGIN)


@pytest.mark.parametrize("count", [0, 5])
def test_too_few_matches_are_no_answer(count: int) -> None:
    with pytest.raises(DegenerateHomographyError, match=f"{count} matches give no homography"):
        located((GRID[:count], GRID[:count] + ORIGIN))


def test_matches_beyond_the_search_radius_do_not_count() -> None:
    """A corner of the window is farther away than its edges are."""
    assert located((GRID, GRID + ORIGIN + [0.0, REACH_PX - 1.0])).confidence > 0.99
    with pytest.raises(DegenerateHomographyError):
        located((GRID, GRID + ORIGIN + [REACH_PX - 10.0, REACH_PX - 10.0]))


def test_matches_beyond_the_map_do_not_count() -> None:
    half = located((GRID, GRID + ORIGIN + 3.0), map_ends_px=REACH_PX + 48).corners_px
    assert half[1] == pytest.approx(LEFT + ORIGIN + 3.0, abs=0.01)
    assert half[2] == pytest.approx(RIGHT + ORIGIN)
    with pytest.raises(DegenerateHomographyError):
        located((GRID, GRID + ORIGIN), map_ends_px=REACH_PX)


@given(st.integers(6, 500), st.integers(0, 500))
def test_belief_follows_brown_and_lowe(inliers: int, outliers: int) -> None:
    """They accept at a probability of 0.999, that is beyond 8.0 + 0.3 n inliers of n (sec. 3.2)."""
    matches = inliers + outliers
    believed = match_belief(inliers, matches) > 0.999
    if abs(inliers - (7.97 + 0.3116 * matches)) > 0.1:
        assert believed == (inliers > 7.97 + 0.3116 * matches)
    assert match_belief(inliers, matches + 1) <= match_belief(inliers, matches)
