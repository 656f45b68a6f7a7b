"""Homographies, boxes and conventions of the displacement networks."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px
from uasthn_cli.matching.displacement.homography import (
    corners_at_width,
    displacement_at_resized,
    map_points,
    recover_displacement,
    resize_to_network,
    sample_boxes,
    solve_homography,
    square_corners,
)
from uasthn_cli.matching.displacement.ihn import CELLS, looked_at
from uasthn_cli.matching.displacement.sthn import bounding_boxes, displacement_of_boxes

displacements = st.lists(st.floats(-60.0, 60.0, width=32), min_size=8, max_size=8).map(
    lambda values: torch.tensor(values, dtype=torch.float64).reshape(1, 4, 2)
)


def whole() -> Tensor:
    return square_corners(256, torch.zeros(1, dtype=torch.float64))[None]


def test_no_displacement_is_no_homography() -> None:
    H = solve_homography(whole(), whole())
    assert torch.allclose(H, torch.eye(3, dtype=torch.float64)[None], atol=1e-12)
    steps = torch.arange(CELLS, dtype=torch.float32)
    places = looked_at(torch.zeros(1, 4, 2))
    assert torch.equal(places[0, :, :, 0], steps.expand(CELLS, -1))
    assert torch.equal(places[0, :, :, 1], steps[:, None].expand(-1, CELLS))


@given(displacements)
def test_the_dlt_sends_corners_to_corners_as_the_packages_other_one_does(moved: Tensor) -> None:
    H = solve_homography(whole(), whole() + moved)
    assert torch.allclose(map_points(H, whole()), whole() + moved, atol=1e-6)
    expected = homography_from_corners(image_corners_px(256, 256), (whole() + moved)[0].numpy())
    assert H[0].numpy() == pytest.approx(expected, rel=1e-6, abs=1e-8)


@given(displacements, st.floats(-200.0, 200.0), st.floats(-200.0, 200.0))
def test_a_shift_of_the_answer_shifts_the_homography(moved: Tensor, x: float, y: float) -> None:
    shift = torch.tensor([x, y], dtype=torch.float64)
    inside = whole() * 0.7 + 20.0
    here = map_points(solve_homography(whole(), whole() + moved), inside)
    there = map_points(solve_homography(whole(), whole() + moved + shift), inside)
    assert torch.allclose(there, here + shift, atol=1e-6)


def test_corners_without_a_homography_spoil_only_their_own_sample() -> None:
    good = torch.zeros(1, 4, 2)
    collapsed = -4.0 * square_corners(CELLS, good)[None]
    places = looked_at(torch.cat([good, collapsed]))
    assert bool(places[0].isfinite().all())
    assert not bool(places[1].isfinite().any())


@given(displacements, st.integers(0, 16), st.integers(0, 16))
def test_a_crop_that_saw_the_same_homography_recovers_it(moved: Tensor, x: int, y: int) -> None:
    crop = square_corners(240, moved)[None] + torch.tensor([x, y])
    seen = map_points(solve_homography(whole(), whole() + moved), crop)
    recovered = recover_displacement(crop, seen - whole())
    assert torch.allclose(recovered, moved, atol=1e-5)


@given(st.integers(2, 4000), displacements)
def test_displacements_and_corners_at_a_width_are_inverses(width_px: int, moved: Tensor) -> None:
    corners_px = corners_at_width(moved, width_px)
    assert torch.allclose(displacement_at_resized(corners_px, width_px), moved, atol=1e-9)


def test_the_box_of_no_displacement_is_the_image_and_its_padding() -> None:
    box = bounding_boxes(torch.zeros(1, 4, 2), 1536, 32.0)
    expected = torch.tensor([[-32.0, -32.0], [1567.0, -32.0], [-32.0, 1567.0], [1567.0, 1567.0]])
    assert torch.equal(box[0], expected)


@given(displacements)
def test_boxes_hold_the_displaced_corners(moved: Tensor) -> None:
    boxes_px = bounding_boxes(moved, 1536, 0.0)
    corners_px = 6.0 * (whole() + moved)
    assert bool((corners_px >= boxes_px[:, :1] - 1e-6).all())
    assert bool((corners_px <= boxes_px[:, 3:] + 1e-6).all())
    sides_px = boxes_px[:, 3] - boxes_px[:, 0]
    assert torch.allclose(sides_px[:, 0], sides_px[:, 1])
    back = displacement_of_boxes(boxes_px, displacement_at_resized(boxes_px, 1536) * 0.0, 1536)
    assert torch.allclose(corners_at_width(back, 1536), boxes_px, atol=1e-6)


def test_a_box_of_the_whole_image_is_the_image() -> None:
    images = torch.rand(2, 3, 256, 256)
    boxes_px = square_corners(256, images).expand(2, -1, -1)
    assert torch.allclose(sample_boxes(images, boxes_px), images, atol=1e-4)
    assert torch.allclose(resize_to_network(images), images, atol=1e-5)


def test_beyond_the_image_all_is_black() -> None:
    images = torch.ones(1, 3, 300, 300)
    boxes_px = square_corners(256, images)[None] + 298.0
    sampled = sample_boxes(images, boxes_px)
    assert float(sampled[..., :2, :2].min()) == pytest.approx(1.0, abs=1e-4)
    assert float(sampled[..., 3:, 3:].max()) == 0.0
