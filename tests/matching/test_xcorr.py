"""The learned estimator around encoders that are simple known functions.

The first iteration of an estimate is the search's own answer.
"""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from known_model import known_encoders
from matching_scene import centred_origin, encoded, full_view, map_window, thermal_cut
from small_flight import ground_texture

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.matching import search
from uasthn_cli.matching.appearance import CHANNELS
from uasthn_cli.matching.architecture import HALO_PX, STRIDE_PX, XcorrArchitecture
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_encoders import TorchEncoders
from uasthn_cli.matching.xcorr import XcorrEstimator
from uasthn_cli.seam import Aligner, CacheableEncoder, Estimate, Similarity
from uasthn_cli.types import FloatArray, MapWindow, Ortho
from uasthn_cli.uncertainty.views import crop_views_px

GREY = ground_texture(5)[:192, :288]
CORNER_PX, SIZE_PX = (122, 58), (80, 64)


def locate(
    window: MapWindow,
    thermal: Ortho,
    views_px: FloatArray | None = None,
    *,
    symmetries: int = 8,
) -> Estimate:
    estimator = XcorrEstimator(known_encoders(), symmetries=symmetries)
    views = full_view(thermal) if views_px is None else views_px
    features = encoded(estimator, window)
    return estimator.estimate(features, thermal, views, centred_origin(window, thermal))


def test_map_features_have_a_stack_per_symmetry_and_two_of_appearance() -> None:
    features = encoded(XcorrEstimator(known_encoders(), symmetries=3), map_window(GREY))
    assert features.values.shape == (3 + len(CHANNELS), 96, 144)
    brightness = (GREY / 255.0).reshape(96, 2, 144, 2).mean(axis=(1, 3))
    assert np.abs(features.values[3] - brightness).max() < 1e-3


def test_map_features_are_zero_off_the_map() -> None:
    valid = np.ones(GREY.shape, np.bool_)
    valid[:, 201:] = False
    features = encoded(XcorrEstimator(known_encoders(), symmetries=3), map_window(GREY, valid))
    assert features.valid.sum() == 96 * 100
    assert (features.values[:, ~features.valid] == 0).all()
    assert (features.values[:, features.valid] != 0).any(axis=0).all()


@pytest.mark.parametrize("symmetries", [1, 8])
def test_convention_a_cut_out_is_found_where_it_was_cut(symmetries: int) -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    estimate = locate(map_window(GREY), thermal, symmetries=symmetries)
    assert estimate.corners_px.shape == (1, 4, 2)
    shift = estimate.corners_px[0] - full_view(thermal)[0]
    assert shift == pytest.approx(np.array([CORNER_PX] * 4), abs=0.3)


def test_what_the_frame_does_not_show_has_no_influence() -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX, inset_px=10)
    soiled = Ortho(
        np.where(thermal.valid, thermal.image, 7.0).astype(np.float32),
        thermal.valid,
        thermal.gsd_m,
        thermal.H_frame_ortho,
        thermal.nadir_px,
    )
    found = locate(map_window(GREY), thermal)
    assert found.corners_px[0, 0] == pytest.approx(CORNER_PX, abs=0.3)
    assert locate(map_window(GREY), soiled).corners_px == pytest.approx(found.corners_px, abs=1e-3)


def test_places_mostly_off_the_map_do_not_count() -> None:
    valid = np.ones(GREY.shape, np.bool_)
    valid[:, CORNER_PX[0] + 30 :] = False
    estimate = locate(map_window(GREY, valid), thermal_cut(GREY, CORNER_PX, SIZE_PX))
    assert estimate.corners_px[0, 0, 0] + SIZE_PX[0] / 2 <= CORNER_PX[0] + 30 + STRIDE_PX


def test_a_frame_that_hangs_over_the_maps_edge_is_found() -> None:
    valid = np.ones(GREY.shape, np.bool_)
    valid[:, CORNER_PX[0] + 56 :] = False
    estimate = locate(map_window(GREY, valid), thermal_cut(GREY, CORNER_PX, SIZE_PX))
    assert estimate.corners_px[0, 0] == pytest.approx(CORNER_PX, abs=1.0)


def test_every_view_gives_its_own_answer() -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    elsewhere = thermal_cut(GREY, (CORNER_PX[0] + 8, CORNER_PX[1] - 6), SIZE_PX)
    image = thermal.image.copy()
    image[:, 40:] = elsewhere.image[:, 40:]
    mixed = Ortho(image, thermal.valid, thermal.gsd_m, thermal.H_frame_ortho, thermal.nadir_px)
    views = np.concatenate([full_view(mixed)] * 2)
    views[0, [1, 3], 0] = 39.0
    views[1, [0, 2], 0] = 40.0
    left, right = (locate(map_window(GREY), mixed, views).corners_px - views)[:, 0]
    assert left == pytest.approx(CORNER_PX, abs=0.5)
    assert right == pytest.approx((CORNER_PX[0] + 8, CORNER_PX[1] - 6), abs=0.5)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_views_sought_around_peaks_are_where_a_search_of_all_shifts_has_them(
    noise: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    image = cut.image + noise * np.random.default_rng(3).normal(size=cut.image.shape)
    thermal = replace(cut, image=image.astype(np.float32))
    views = crop_views_px(*SIZE_PX, CropTtaConfig(views=5), "frame.png")
    around_peaks = locate(map_window(GREY), thermal, views).corners_px
    monkeypatch.setattr(search, "_BOX_REACH_CELLS", max(GREY.shape))
    assert len(list(search.peak_boxes(np.zeros((30, 40))))) == 1
    everywhere = locate(map_window(GREY), thermal, views).corners_px
    assert around_peaks == pytest.approx(everywhere, abs=1e-2)


def test_belief_is_high_in_a_singular_place_and_low_among_look_alikes() -> None:
    thermal = thermal_cut(GREY, CORNER_PX, SIZE_PX)
    assert locate(map_window(GREY), thermal).confidence > 0.9
    tile = GREY[:64, :48]
    look_alikes = np.tile(tile, (3, 6))
    cut = thermal_cut(look_alikes, (96, 64), SIZE_PX)
    assert locate(map_window(look_alikes), cut).confidence < 0.6


def test_without_any_map_there_is_no_belief() -> None:
    valid = np.zeros(GREY.shape, np.bool_)
    valid[:, :8] = True
    estimate = locate(map_window(GREY, valid), thermal_cut(GREY, CORNER_PX, SIZE_PX))
    assert estimate.confidence == 0.0


def test_nothing_is_found_beyond_the_reach_of_the_window() -> None:
    corner_px = (GREY.shape[1] - SIZE_PX[0] - 2, 2)
    thermal, window = thermal_cut(GREY, corner_px, SIZE_PX), map_window(GREY)
    reach = (GREY.shape[0] - SIZE_PX[1]) / 2
    origin = centred_origin(window, thermal)
    assert np.hypot(*(np.array(corner_px) - origin)) > reach
    found = locate(window, thermal).corners_px[0, 0]
    assert np.hypot(*(found - origin)) <= reach + STRIDE_PX


def turned_cut(yaw_deg: float, scale: float) -> Ortho:
    """Return a cut of the map whose content lies turned clockwise and enlarged on it."""
    width, height = SIZE_PX
    cosine, sine = (scale * f(math.radians(yaw_deg)) for f in (math.cos, math.sin))
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    linear = np.array([[cosine, -sine], [sine, cosine]])
    to_map = np.hstack([linear, (CORNER_PX + middle - linear @ middle)[:, None]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    shown = cv2.warpAffine(GREY.astype(np.float32), to_map, SIZE_PX, flags=flags)
    return thermal_cut(shown, (0, 0), SIZE_PX)


@pytest.mark.parametrize(("yaw_deg", "scale"), [(0.0, 1.0), (4.0, 0.97), (-2.5, 1.05)])
def test_convention_turn_and_scale_of_a_frame_are_seen(yaw_deg: float, scale: float) -> None:
    """Clockwise on the map is positive; the frame's own place is only about known."""
    estimator = XcorrEstimator(known_encoders(), symmetries=8)
    window = map_window(GREY[CORNER_PX[1] - 14 : CORNER_PX[1] + 82, 100:228])
    turns, sizes = (-2.5, 0.0, 4.0), (0.97, 1.0, 1.05)
    hypotheses = [Similarity(math.radians(turn), size) for turn in turns for size in sizes]
    features = encoded(estimator, window)
    scores_of = estimator.fit_scores(features, turned_cut(yaw_deg, scale), np.array([20.0, 16.0]))
    scores = scores_of(hypotheses)
    best = hypotheses[int(scores.argmax())]
    assert (math.degrees(best.yaw_rad), best.scale) == pytest.approx((yaw_deg, scale))
    assert isinstance(estimator, Aligner)


def test_members_of_an_ensemble_average_their_scores() -> None:
    window, thermal = map_window(GREY), thermal_cut(GREY, CORNER_PX, SIZE_PX)
    alone, twice = (
        XcorrEstimator(models, symmetries=1)
        for models in (known_encoders(), [known_encoders()] * 2)
    )
    assert len(twice.encode_map(window)) == 2 * len(alone.encode_map(window)) - 2
    origin = centred_origin(window, thermal)
    found = [
        estimator.estimate(encoded(estimator, window), thermal, full_view(thermal), origin)
        for estimator in (alone, twice)
    ]
    np.testing.assert_allclose(found[0].corners_px, found[1].corners_px, atol=1e-3)


def test_half_a_window_is_encoded_like_the_whole() -> None:
    """Tiles rely on it: a tile's features do not depend on what lies beyond its halo."""
    torch.manual_seed(0)
    model = XcorrModel(XcorrArchitecture(feature_channels=4, widths=(6, 8, 8, 8)))
    estimator = XcorrEstimator(TorchEncoders(model), symmetries=1)
    window = map_window(ground_texture(6)[:256, :384])
    half = MapWindow(
        window.image[:, :256], window.valid[:, :256], window.box, window.grid, window.statistics
    )
    kept = (256 - HALO_PX) // STRIDE_PX
    whole = estimator.encode_map(window)[..., :kept]
    alone = estimator.encode_map(half)[..., :kept]
    assert np.abs(whole - alone).max() < 0.02 * np.abs(whole).max()


def test_whoever_encodes_alike_says_so() -> None:
    torch.manual_seed(3)
    architecture = XcorrArchitecture(feature_channels=4, widths=(4, 4, 4, 4))
    model = XcorrModel(architecture)
    same = XcorrModel(architecture)
    same.load_state_dict(model.state_dict())
    first, again, other = (TorchEncoders(one) for one in (model, same, XcorrModel(architecture)))
    one = XcorrEstimator(first, symmetries=2)
    assert isinstance(one, CacheableEncoder)
    assert XcorrEstimator(again, symmetries=2).encoding_id == one.encoding_id
    others = [
        XcorrEstimator(other, symmetries=2),
        XcorrEstimator(first, symmetries=3),
        XcorrEstimator(first, symmetries=2, appearance=False),
        XcorrEstimator([first, first], symmetries=4),
    ]
    assert len({one.encoding_id, *(entry.encoding_id for entry in others)}) == 5
