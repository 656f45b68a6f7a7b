"""Phase correlation and mutual information find a known shift, whatever the sign of contrast."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matching_scene import centred_origin, encoded, full_view, map_window, thermal_cut
from mutual_information import MiChannel, MutualInformationEstimator, mutual_information
from numpy.typing import NDArray
from phase_correlation import PhaseCorrelationEstimator
from shift_search import ShiftSearch
from small_flight import ground_texture

from uasthn_cli.types import MapWindow, Ortho

GREY = ground_texture(3)[40:200, 60:316]
CORNER_PX, SIZE_PX = (80, 45), (64, 48)

MAKERS: list[Callable[[], ShiftSearch]] = [
    PhaseCorrelationEstimator,
    MutualInformationEstimator,
    lambda: MutualInformationEstimator(MiChannel.LOCAL),
]
every_search = pytest.mark.parametrize("make", MAKERS, ids=["phase", "mi", "mi-local"])


def shift_found(estimator: ShiftSearch, window: MapWindow, thermal: Ortho) -> NDArray[np.float64]:
    """Return where ``thermal``'s first pixel was found ``(x, y)``."""
    views = full_view(thermal)
    origin = centred_origin(window, thermal)
    estimate = estimator.estimate(encoded(estimator, window), thermal, views, origin)
    shifts: NDArray[np.float64] = estimate.corners_px[0] - views[0]
    assert np.ptp(shifts, axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)
    first: NDArray[np.float64] = shifts[0]
    return first


@every_search
@pytest.mark.parametrize("gain", [1.0, -0.2])
def test_convention_a_cut_out_is_found_where_it_was_cut(
    make: Callable[[], ShiftSearch], gain: float
) -> None:
    thermal = thermal_cut(128.0 + gain * (GREY - 128.0), CORNER_PX, SIZE_PX)
    assert shift_found(make(), map_window(GREY), thermal) == pytest.approx(CORNER_PX, abs=0.1)


@every_search
def test_what_the_frame_does_not_show_has_no_influence(make: Callable[[], ShiftSearch]) -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX, inset_px=9)
    soiled = np.where(thermal.valid, thermal.image, 7.0).astype(np.float32)
    other = Ortho(soiled, thermal.valid, thermal.gsd_m, thermal.H_frame_ortho, thermal.nadir_px)
    found = shift_found(make(), map_window(GREY), thermal)
    assert found == pytest.approx(CORNER_PX, abs=0.1)
    assert shift_found(make(), map_window(GREY), other) == pytest.approx(found, abs=1e-6)


@every_search
def test_a_frame_that_hangs_over_the_maps_edge_is_found(make: Callable[[], ShiftSearch]) -> None:
    valid = np.ones(GREY.shape, np.bool_)
    valid[:, CORNER_PX[0] + 48 :] = False
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    assert shift_found(make(), map_window(GREY, valid), thermal) == pytest.approx(
        CORNER_PX, abs=0.5
    )


@every_search
def test_nothing_is_found_beyond_the_reach_of_the_window(make: Callable[[], ShiftSearch]) -> None:
    thermal = thermal_cut(GREY, (GREY.shape[1] - SIZE_PX[0] - 2, 2), SIZE_PX)
    window = map_window(GREY)
    reach = (GREY.shape[0] - SIZE_PX[1]) / 2
    origin = centred_origin(window, thermal)
    assert np.hypot(*(shift_found(make(), window, thermal) - origin)) <= reach + 1


@every_search
def test_a_map_without_data_leaves_the_prior(make: Callable[[], ShiftSearch]) -> None:
    window = map_window(GREY, np.eye(*GREY.shape, dtype=np.bool_))
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    origin = centred_origin(window, thermal)
    assert shift_found(make(), window, thermal) == pytest.approx(origin)


def test_mutual_information_sees_what_correlation_does_not() -> None:
    """Grey values folded at the middle correlate with nothing, and still tell where they are."""
    folded = 2.0 * np.abs(GREY - np.median(GREY))
    thermal = thermal_cut(folded, CORNER_PX, SIZE_PX)
    found = shift_found(MutualInformationEstimator(), map_window(GREY), thermal)
    assert found == pytest.approx(CORNER_PX, abs=0.5)


@given(st.lists(st.floats(0.1, 10.0), min_size=2, max_size=6))
def test_independent_values_share_no_information(weights: list[float]) -> None:
    joint = np.outer(weights, weights[::-1])
    assert mutual_information(joint[:, :, None]) == pytest.approx([0.0], abs=1e-9)


@given(st.lists(st.floats(0.1, 10.0), min_size=2, max_size=6))
def test_equal_values_share_their_entropy(weights: list[float]) -> None:
    share = np.array(weights) / sum(weights)
    entropy = -np.sum(share * np.log(share))
    assert mutual_information(np.diag(weights)[:, :, None]) == pytest.approx([entropy], abs=1e-6)
