"""Boxes of the second stage in training."""

import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from uasthn_cli.matching.displacement.sthn import bounding_boxes, displacement_of_boxes
from uasthn_cli.training.displacement.boxes import displacement_in_boxes, perturbed_boxes


def third(shift_px: float = 0.0) -> Tensor:
    """Return the displacement of a thermal image a third as wide as the satellite image."""
    corners = torch.tensor([[0.0, 0.0], [85.0, 0.0], [0.0, 85.0], [85.0, 85.0]]) + 85 + shift_px
    whole = torch.tensor([[0.0, 0.0], [255.0, 0.0], [0.0, 255.0], [255.0, 255.0]])
    return (corners - whole)[None]


def sides(boxes: Tensor) -> Tensor:
    return boxes[:, 3] - boxes[:, 0]


def test_without_noise_they_are_those_of_evaluation_without_padding() -> None:
    boxes = perturbed_boxes(third(), torch.zeros(1, 4), 1536, 64.0)
    assert torch.allclose(boxes, bounding_boxes(third(), 1536, 0.0), atol=1e-3)


def test_edges_move_one_by_one_and_the_longer_side_makes_the_square() -> None:
    plain = bounding_boxes(third(), 1536, 0.0)
    right = perturbed_boxes(third(), torch.tensor([[0.0, 0.0, 1.0, 0.0]]), 1536, 64.0)
    assert torch.allclose(sides(right), sides(plain) + 64, atol=1e-3)
    middle = (right[:, 0] + right[:, 3] - plain[:, 0] - plain[:, 3]) / 2
    assert torch.allclose(middle, torch.tensor([[32.0, 0.0]]), atol=1e-3)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_perturbed_boxes_are_square_and_near(noise: list[float]) -> None:
    boxes = perturbed_boxes(third(), torch.tensor([noise]), 1536, 64.0)
    side = sides(boxes)[0]
    plain = sides(bounding_boxes(third(), 1536, 0.0))[0]
    assert torch.isclose(side[0], side[1])
    assert (side - plain).abs().max() <= 128 + 1e-2
    assert torch.equal(boxes[0, 1], torch.stack([boxes[0, 3, 0], boxes[0, 0, 1]]))


def test_a_first_stage_that_collapsed_still_gives_a_box() -> None:
    whole = torch.tensor([[0.0, 0.0], [255.0, 0.0], [0.0, 255.0], [255.0, 255.0]])
    in_one_place = (torch.full((4, 2), 99.0) - whole)[None]
    boxes = perturbed_boxes(in_one_place, torch.tensor([[1.0, 1.0, -1.0, -1.0]]), 1536, 64.0)
    assert (sides(boxes) >= 64 - 1e-3).all()


@given(st.integers(0, 10_000), st.sampled_from([300, 1536]))
def test_truth_in_boxes_is_the_inverse_of_the_answer(seed: int, width_px: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    truth = third() + 20 * torch.rand(1, 4, 2, generator=generator)
    noise = 2 * torch.rand(1, 4, generator=generator) - 1
    boxes = perturbed_boxes(third(5.0), noise, width_px, width_px / 24)
    fine = displacement_in_boxes(boxes, truth, width_px)
    assert torch.allclose(displacement_of_boxes(boxes, fine, width_px), truth, atol=1e-2)
