"""Where crops lie: inside the frame, reproducibly, as the paper describes."""

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.config import CropTtaConfig, Sampling
from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.uncertainty.views import crop_views_px

WIDTH_PX, HEIGHT_PX = 640, 512


@given(
    width_px=st.integers(32, 2000),
    height_px=st.integers(32, 2000),
    views=st.integers(1, 30),
    sampling=st.sampled_from(list(Sampling)),
    offset_fraction=st.floats(0.0, 0.9),
    seed=st.integers(0, 2**31),
    name=st.text(max_size=20),
)
def test_views_lie_inside_the_frame_and_have_their_size(
    width_px: int,
    height_px: int,
    views: int,
    sampling: Sampling,
    offset_fraction: float,
    seed: int,
    name: str,
) -> None:
    config = CropTtaConfig(views, sampling, offset_fraction, seed)
    found = crop_views_px(width_px, height_px, config, name)
    assert found.shape == (views, 4, 2)
    assert (found[0] == image_corners_px(width_px, height_px)).all()
    assert found.min() >= 0.0
    assert (found <= found[0, 3] + 1e-9).all()
    kept = 1 - offset_fraction
    crop = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * [
        width_px * kept - 1,
        height_px * kept - 1,
    ]
    for view in found[1:]:
        assert view - view[0] == pytest.approx(crop)


def test_convention_the_default_offset_is_32_of_512() -> None:
    crops = crop_views_px(512, 384, CropTtaConfig(), "frame.png")[1:]
    assert crops[:, 1, 0] - crops[:, 0, 0] + 1 == pytest.approx([480.0] * 4)
    assert crops[:, 2, 1] - crops[:, 0, 1] + 1 == pytest.approx([360.0] * 4)


def test_random_crops_depend_on_seed_and_name_alone() -> None:
    config = CropTtaConfig(seed=3)
    first = crop_views_px(WIDTH_PX, HEIGHT_PX, config, "a.png")
    crop_views_px(WIDTH_PX, HEIGHT_PX, config, "b.png")
    assert (crop_views_px(WIDTH_PX, HEIGHT_PX, config, "a.png") == first).all()
    other_name = crop_views_px(WIDTH_PX, HEIGHT_PX, config, "b.png")
    other_seed = crop_views_px(WIDTH_PX, HEIGHT_PX, CropTtaConfig(seed=4), "a.png")
    for other in (other_name, other_seed):
        assert not np.isclose(other[1:], first[1:]).all(axis=(1, 2)).any()


def test_a_name_that_is_not_unicode_is_a_name() -> None:
    name = os.fsdecode(b"fl\xfcg.png")
    assert crop_views_px(WIDTH_PX, HEIGHT_PX, CropTtaConfig(), name).shape == (5, 4, 2)


def test_random_crops_fill_the_room_they_have() -> None:
    config = CropTtaConfig(views=2001)
    places = crop_views_px(WIDTH_PX, HEIGHT_PX, config, "a.png")[1:, 0]
    room = config.offset_fraction * np.array([WIDTH_PX, HEIGHT_PX])
    assert places.mean(axis=0) == pytest.approx(room / 2, rel=0.05)
    assert places.std(axis=0) == pytest.approx(room / np.sqrt(12), rel=0.05)


def test_more_views_keep_the_first_ones() -> None:
    few = crop_views_px(WIDTH_PX, HEIGHT_PX, CropTtaConfig(views=3), "a.png")
    many = crop_views_px(WIDTH_PX, HEIGHT_PX, CropTtaConfig(views=8), "a.png")
    assert (many[:3] == few).all()


def test_convention_a_grid_of_five_is_the_frame_and_its_four_corners() -> None:
    config = CropTtaConfig(views=5, sampling=Sampling.GRID, offset_fraction=0.25)
    full, *crops = crop_views_px(WIDTH_PX, HEIGHT_PX, config, "a.png")
    assert {tuple(crop[0]) for crop in crops} == {(0, 0), (160, 0), (0, 128), (160, 128)}
    for corner in range(4):
        assert any((crop[corner] == full[corner]).all() for crop in crops)


def test_a_grid_is_the_same_for_every_frame_and_seed() -> None:
    one = CropTtaConfig(sampling=Sampling.GRID, seed=1)
    two = CropTtaConfig(sampling=Sampling.GRID, seed=2)
    first = crop_views_px(WIDTH_PX, HEIGHT_PX, one, "a.png")
    assert (crop_views_px(WIDTH_PX, HEIGHT_PX, two, "b.png") == first).all()


@pytest.mark.parametrize("views", [6, 10, 13])
def test_larger_grids_begin_with_the_corners_and_repeat_nothing(views: int) -> None:
    config = CropTtaConfig(views=views, sampling=Sampling.GRID)
    crops = crop_views_px(WIDTH_PX, HEIGHT_PX, config, "a.png")[1:]
    corners = {(0, 0), (40, 0), (0, 32), (40, 32)}
    assert {tuple(crop[0]) for crop in crops[:4]} == corners
    assert len({tuple(crop[0]) for crop in crops}) == views - 1
