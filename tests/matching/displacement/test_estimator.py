"""The paper's networks behind the common seam, with networks whose answer is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matching_scene import centred_origin, encoded, full_view, map_window, thermal_cut
from small_displacement_models import FIRST, SETTINGS, small_model, small_weights
from small_flight import ground_texture

from uasthn_cli.errors import WeightsError
from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    homography_from_corners,
    image_corners_px,
    transform_points,
)
from uasthn_cli.matching.displacement.estimator import (
    DisplacementEstimator,
    Square,
    _carried_std_px,
    open_displacement,
)
from uasthn_cli.matching.displacement.ihn import IterativeHomographyNetwork
from uasthn_cli.matching.displacement.model import DisplacementModel
from uasthn_cli.matching.registry import open_estimator
from uasthn_cli.seam import Estimate
from uasthn_cli.types import FloatArray

GREY = ground_texture(3)
CORNER_PX, SIZE_PX = (120, 90), (81, 65)
PER_PIXEL = 256.0 / (3 * 81)
"""Pixels at W_R for one of the window's square."""

CENTRED = PER_PIXEL * 81.0 * np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
"""The displacement at W_R of an ortho in the middle of a square three times its width."""


def answering(name: str, displacement: FloatArray) -> DisplacementEstimator:
    """Return an estimator whose first stage regresses one displacement ``(4, 2)`` whatever."""
    estimator = DisplacementEstimator(small_model(name))
    weights = estimator._network.state_dict()
    last = "head.4" if name == "dhn" else "update_block_4.cnn.layer10.3"
    weights[f"{last}.weight"].zero_()
    if name == "dhn":
        weights["head.4.bias"].copy_(torch.from_numpy(displacement / 32.0).flatten())
    else:
        weights[f"{last}.bias"].copy_(torch.from_numpy(displacement[0] / 2.0))
    return estimator


def estimate(estimator: DisplacementEstimator, views: FloatArray | None = None) -> Estimate:
    window = map_window(GREY)
    thermal = thermal_cut(0.5 * GREY + 40.0, CORNER_PX, SIZE_PX)
    origin = centred_origin(window, thermal)
    views = full_view(thermal) if views is None else views
    return estimator.estimate(encoded(estimator, window), thermal, views, origin)


def truth_by_prior() -> FloatArray:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    corners: FloatArray = full_view(thermal) + centred_origin(map_window(GREY), thermal)
    return corners


def with_crops() -> FloatArray:
    full = full_view(thermal_cut(GREY, CORNER_PX, SIZE_PX))
    crop = (full[0] * 0.9)[None]
    return np.concatenate([full, crop, crop + np.array([4.0, 3.0])])


def test_a_regressed_displacement_is_a_place_in_the_window() -> None:
    found = estimate(answering("dhn", CENTRED))
    assert found.corners_px == pytest.approx(truth_by_prior(), abs=1.0)
    assert found.confidence == 1.0
    assert found.scores is None


def test_a_shift_at_the_networks_width_is_a_shift_in_the_window() -> None:
    here = estimate(answering("dhn", CENTRED)).corners_px
    there = estimate(answering("dhn", CENTRED + PER_PIXEL * np.array([7.0, -3.0]))).corners_px
    assert there - here == pytest.approx(np.broadcast_to([7.0, -3.0], here.shape), abs=1e-3)


def test_steps_add_up() -> None:
    shift = np.broadcast_to([12.0, -8.0], (4, 2))
    found = estimate(answering("ihn", shift))
    none = estimate(answering("ihn", np.zeros((4, 2))))
    moved = found.corners_px - none.corners_px
    assert moved == pytest.approx(np.broadcast_to(shift / PER_PIXEL, moved.shape), abs=1e-3)


@pytest.mark.parametrize("name", ["dhn", "ihn", "sthn"])
def test_views_of_a_network(name: str) -> None:
    found = estimate(DisplacementEstimator(small_model(name)), with_crops())
    assert found.corners_px.shape == (3, 4, 2)
    assert np.isfinite(found.corners_px).all()
    alone = estimate(DisplacementEstimator(small_model(name)))
    assert found.corners_px[0] == pytest.approx(alone.corners_px[0], abs=1e-2)


def test_early_stopping_leaves_the_answer(tmp_path: Path) -> None:
    path = small_weights(tmp_path, "ihn")
    stopped = open_estimator("ihn", weights=[path], device="cpu", ue_iterations=1)
    whole = open_estimator("ihn", weights=[path], device="cpu")
    assert isinstance(stopped, DisplacementEstimator)
    assert isinstance(whole, DisplacementEstimator)
    ours, theirs = estimate(stopped, with_crops()), estimate(whole, with_crops())
    assert ours.corners_px[0] == pytest.approx(theirs.corners_px[0], abs=1e-3)
    assert np.abs(ours.corners_px[1:] - theirs.corners_px[1:]).max() > 1e-3


def test_a_second_stage_moves_all_views_alike() -> None:
    found = estimate(DisplacementEstimator(small_model("sthn")), with_crops())
    first = estimate(DisplacementEstimator(small_model("ihn")), with_crops())
    H = homography_from_corners(first.corners_px[0], found.corners_px[0])
    assert found.corners_px == pytest.approx(transform_points(H, first.corners_px), abs=1e-6)
    assert np.abs(found.corners_px - first.corners_px).max() > 1e-2


def test_corners_that_make_no_homography_are_no_answer() -> None:
    with pytest.raises(DegenerateHomographyError):
        estimate(answering("dhn", np.full((4, 2), np.nan)))


def test_a_first_stage_serves_alone(tmp_path: Path) -> None:
    assert open_displacement("ihn", small_weights(tmp_path, "sthn"), "cpu").name == "ihn"


def test_weights_are_needed_and_must_fit(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="--estimator ihn has no weights in the box"):
        open_estimator("ihn")
    path = small_weights(tmp_path, "dhn")
    with pytest.raises(WeightsError, match="are for dhn, not for sthn"):
        open_estimator("sthn", weights=[path])
    with pytest.raises(WeightsError, match="takes 0"):
        open_displacement("dhn", path, "cpu", ue_iterations=1)


def test_squares_reach_beyond_their_image() -> None:
    image = np.arange(12, dtype=np.float32).reshape(1, 3, 4)
    square = Square.around(np.array([3.0, 0.0]), 3.0)
    assert square == Square((2, -1), 3)
    assert square.cut(image, -1.0)[0].tolist() == [[-1, -1, -1], [2, 3, -1], [6, 7, -1]]
    away = Square.around(np.array([30.0, 0.0]), 2.4)
    assert away.width_px == 3
    assert (away.cut(image) == 0.0).all()


def square_and_crops() -> FloatArray:
    """Return views whose first is the square that the network sees."""
    full = full_view(thermal_cut(GREY, CORNER_PX, (81, 81)))
    return np.concatenate([full, 0.9 * full])


@pytest.mark.parametrize("views", [square_and_crops()[:1], square_and_crops()])
def test_a_second_head_states_deviations_in_window_pixels(views: FloatArray) -> None:
    network = IterativeHomographyNetwork(replace(FIRST, has_uncertainty_head=True)).eval()
    estimator = DisplacementEstimator(DisplacementModel(network, None, SETTINGS))
    head = {name: value for name, value in network.state_dict().items() if name.startswith("ue_")}
    last = [name for name in head if name.endswith((".weight", ".bias"))][-2:]
    head[last[0]].zero_()
    head[last[1]].fill_(2.0)  # of the logarithm of the variance, whatever is seen
    stated = estimate(estimator, views).modelled_std_px
    assert stated is not None
    assert stated == pytest.approx(np.full((4, 2), np.e / PER_PIXEL), rel=0.01)
    assert estimator.models_std
    silent = DisplacementEstimator(small_model("ihn"))
    assert estimate(silent, views).modelled_std_px is None
    assert not silent.models_std


SQUARE_PX = image_corners_px(101, 101)
DEVIATIONS = arrays(np.float64, (4, 2), elements=st.floats(0.0, 5.0))


@given(DEVIATIONS, arrays(np.float64, (4, 2), elements=st.floats(-20.0, 20.0)))
def test_deviations_of_the_square_are_those_of_a_frame_that_fills_it(
    std_px: FloatArray, distortion_px: FloatArray
) -> None:
    carried = _carried_std_px(SQUARE_PX, SQUARE_PX + distortion_px, std_px, SQUARE_PX)
    assert carried == pytest.approx(std_px, abs=1e-6)
    half_turn = [3, 2, 1, 0]
    turned = _carried_std_px(SQUARE_PX, SQUARE_PX + distortion_px, std_px, SQUARE_PX[half_turn])
    assert turned == pytest.approx(std_px[half_turn], abs=1e-6)


def test_deviations_of_a_turned_frame_are_those_that_moved_corners_give_it() -> None:
    rng = np.random.default_rng(0)
    std_px = rng.uniform(0.05, 0.4, (4, 2))
    corners_px = SQUARE_PX + rng.uniform(-8.0, 8.0, (4, 2)) + 30.0
    diamond_px = np.array([[50.0, 0.0], [100.0, 50.0], [0.0, 50.0], [50.0, 100.0]])
    moved_px = corners_px + std_px * rng.normal(size=(20_000, 4, 2))
    H = homography_from_corners(np.broadcast_to(SQUARE_PX, moved_px.shape), moved_px)
    placed_px = transform_points(H, np.broadcast_to(diamond_px, moved_px.shape))
    carried = _carried_std_px(SQUARE_PX, corners_px, std_px, diamond_px)
    assert carried == pytest.approx(placed_px.std(axis=0), rel=0.03)
