"""Normalised cross-correlation finds a known shift, whatever hides it."""

import cv2
import numpy as np
import pytest
from matching_scene import (
    centred_origin,
    encoded,
    full_view,
    map_window,
    thermal_cut,
)
from numpy.typing import NDArray
from small_flight import ground_texture

from uasthn_cli.matching.ncc import NccChannel, NccEstimator
from uasthn_cli.types import BoolArray, MapWindow, Ortho

GREY = ground_texture(3)[40:200, 60:316]
CORNER_PX, SIZE_PX = (80, 45), (64, 48)


def shift_found(
    window: MapWindow, thermal: Ortho, channel: NccChannel = NccChannel.GREY
) -> NDArray[np.float64]:
    """Return where ``thermal``'s first pixel was found ``(x, y)``."""
    estimator, views = NccEstimator(channel), full_view(thermal)
    features = encoded(estimator, window)
    estimate = estimator.estimate(features, thermal, views, centred_origin(window, thermal))
    assert estimate.corners_px.shape == (1, 4, 2)
    shifts = estimate.corners_px[0] - views[0]
    assert np.ptp(shifts, axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)
    first: NDArray[np.float64] = shifts[0]
    return first


def map_that_ends(column_px: int) -> BoolArray:
    """Return where a map is valid that ends to the right of a column."""
    valid = np.ones(GREY.shape, np.bool_)
    valid[:, column_px:] = False
    return valid


@pytest.mark.parametrize("channel", list(NccChannel))
def test_convention_a_cut_out_is_found_where_it_was_cut(channel: NccChannel) -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    assert shift_found(map_window(GREY), thermal, channel) == pytest.approx(CORNER_PX, abs=0.05)


@pytest.mark.parametrize("channel", list(NccChannel))
def test_contrast_may_be_inverted_and_weak(channel: NccChannel) -> None:
    thermal = thermal_cut(120.0 - 0.2 * GREY, CORNER_PX, SIZE_PX)
    assert shift_found(map_window(GREY), thermal, channel) == pytest.approx(CORNER_PX, abs=0.05)


def test_a_shift_between_pixels_is_found_between_pixels() -> None:
    moved = cv2.warpAffine(
        GREY, np.array([[1.0, 0.0, -0.4], [0.0, 1.0, 0.3]]), GREY.shape[::-1], flags=cv2.INTER_CUBIC
    )
    thermal = thermal_cut(moved, CORNER_PX, SIZE_PX)
    expected = (CORNER_PX[0] + 0.4, CORNER_PX[1] - 0.3)
    assert shift_found(map_window(GREY), thermal) == pytest.approx(expected, abs=0.1)


def test_what_the_frame_does_not_show_has_no_influence() -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX, inset_px=9)
    soiled = Ortho(
        np.where(thermal.valid, thermal.image, 7.0).astype(np.float32),
        thermal.valid,
        thermal.gsd_m,
        thermal.H_frame_ortho,
        thermal.nadir_px,
    )
    found = shift_found(map_window(GREY), thermal)
    assert found == pytest.approx(CORNER_PX, abs=0.05)
    assert shift_found(map_window(GREY), soiled) == pytest.approx(found, abs=1e-9)


@pytest.mark.parametrize("brightness", [0, 200])
def test_a_frame_that_hangs_over_the_maps_edge_is_found(brightness: int) -> None:
    grey = np.clip(GREY // 4 + brightness, 0, 255)
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    window = map_window(grey, map_that_ends(CORNER_PX[0] + 48))
    assert shift_found(window, thermal) == pytest.approx(CORNER_PX, abs=0.5)


def test_places_mostly_off_the_map_do_not_count() -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    window = map_window(GREY, map_that_ends(CORNER_PX[0] + 24))
    found = shift_found(window, thermal)
    assert found[0] + SIZE_PX[0] / 2 <= CORNER_PX[0] + 24 + 1


def test_flat_ground_attracts_no_frame() -> None:
    grey = GREY.copy()
    grey[:, 110:] = 131
    thermal = thermal_cut(GREY, (46, 50), SIZE_PX)
    assert shift_found(map_window(grey), thermal) == pytest.approx((46, 50), abs=0.5)


def test_nothing_is_found_beyond_the_reach_of_the_window() -> None:
    corner_px = (GREY.shape[1] - SIZE_PX[0] - 2, 2)
    thermal = thermal_cut(GREY, corner_px, SIZE_PX)
    window = map_window(GREY)
    reach = (GREY.shape[0] - SIZE_PX[1]) / 2
    origin = centred_origin(window, thermal)
    assert np.hypot(*(np.array(corner_px) - origin)) > reach
    assert np.hypot(*(shift_found(window, thermal) - origin)) <= reach + 1


def test_every_view_gives_its_own_answer() -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    elsewhere = thermal_cut(GREY, (CORNER_PX[0] + 9, CORNER_PX[1] - 5), SIZE_PX)
    image = thermal.image.copy()
    image[:, 32:] = elsewhere.image[:, 32:]
    mixed = Ortho(image, thermal.valid, thermal.gsd_m, thermal.H_frame_ortho, thermal.nadir_px)
    views = np.concatenate([full_view(mixed)] * 2)
    views[0, [1, 3], 0] = 31.0
    views[1, [0, 2], 0] = 32.0
    window = map_window(GREY)
    estimator = NccEstimator()
    origin = centred_origin(window, mixed)
    estimate = estimator.estimate(encoded(estimator, window), mixed, views, origin)
    left, right = (estimate.corners_px - views)[:, 0]
    assert left == pytest.approx(CORNER_PX, abs=0.05)
    assert right == pytest.approx((CORNER_PX[0] + 9, CORNER_PX[1] - 5), abs=0.05)


def test_names_tell_channels_apart() -> None:
    assert NccEstimator().name == "ncc"
    assert NccEstimator(NccChannel.GRADIENT).name == "ncc-gradient"
