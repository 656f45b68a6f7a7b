"""Losses against values computed by hand, and gradients that stay finite."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from uasthn_cli.matching.displacement.homography import recover_displacement
from uasthn_cli.matching.displacement.network import Refinement
from uasthn_cli.training.displacement.losses import (
    crop_displacement,
    croptta_loss,
    direct_modeling_loss,
    sequence_loss,
)


def shift(x: float, y: float, samples: int = 1) -> Tensor:
    """Return displacements ``(samples, 4, 2)`` of a pure shift."""
    return torch.tensor([x, y]).expand(samples, 4, 2)


def crops(*first_px: tuple[float, float], side_px: float = 240.0) -> Tensor:
    """Return corners ``(N, 1, 4, 2)`` of crops that begin there."""
    unit = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    return torch.stack([unit * (side_px - 1) + torch.tensor(place) for place in first_px])[:, None]


def random_displacement(seed: int, reach_px: float, samples: int = 2) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return reach_px * (2 * torch.rand(samples, 4, 2, generator=generator) - 1)


def test_later_steps_count_more() -> None:
    truth = shift(10, 0)
    found = torch.stack([shift(0, 0), shift(8, 4), shift(10, -1)])
    # means over x and y: 10 / 2, (2 + 4) / 2, 1 / 2
    expected = 0.85**2 * 5 + 0.85 * 3 + 0.5
    assert sequence_loss(found, truth, 0.85).item() == pytest.approx(expected, rel=1e-6)


def test_one_step_counts_fully() -> None:
    assert sequence_loss(shift(1, 1)[None], shift(0, 0), 0.85).item() == pytest.approx(1.0)


def test_direct_modeling_is_the_gaussians_log_likelihood() -> None:
    found = torch.stack([shift(3, 3), shift(1, 1)])
    log_variances = torch.stack([torch.full((1, 4, 2), math.log(9.0)), torch.zeros(1, 4, 2)])
    loss = direct_modeling_loss(Refinement(found, log_variances), shift(0, 0), 0.5)
    # step 1: 9 / (2 * 9) + log(9) / 2; step 2: 1 / 2
    assert loss.item() == pytest.approx(0.5 * (0.5 + math.log(3.0)) + 0.5, rel=1e-6)


def test_direct_modeling_is_least_at_the_true_variance() -> None:
    found = shift(5, 5)[None]
    losses = [
        direct_modeling_loss(
            Refinement(found, torch.full((1, 1, 4, 2), math.log(variance))), shift(0, 0), 1.0
        ).item()
        for variance in (5.0, 25.0, 125.0)
    ]
    assert losses[1] == min(losses)


def test_direct_modeling_without_a_head_is_refused() -> None:
    with pytest.raises(ValueError, match="uncertainty head"):
        direct_modeling_loss(Refinement(shift(0, 0)[None]), shift(0, 0), 0.85)


def test_crops_count_like_the_whole_image() -> None:
    corners = crops((0.0, 0.0), (15.0, 7.0))
    truth = shift(20, -30)
    own = [crop_displacement(corner, truth) for corner in corners]
    found = torch.cat([truth + shift(2, 0), own[0] + shift(0, 4), own[1] + shift(6, 6)])[None]
    # a crop that is shifted shifts the whole image as far
    loss = croptta_loss(found, truth, corners, 0.85)
    assert loss.item() == pytest.approx(1 + 2 + 6, abs=1e-3)


def test_convention_views_follow_each_other_sample_within_view() -> None:
    corners = crops((16.0, 0.0)).expand(1, 2, 4, 2)
    truth = torch.cat([shift(20, 0), shift(0, -50)])
    found = torch.cat([truth, crop_displacement(corners[0], truth)])[None]
    assert croptta_loss(found, truth, corners, 0.85).item() == pytest.approx(0.0, abs=1e-3)


def test_without_crops_it_is_the_sequence_loss() -> None:
    found, truth = random_displacement(0, 50)[None], random_displacement(1, 50)
    none = torch.zeros(0, 2, 4, 2)
    assert croptta_loss(found, truth, none, 0.85) == sequence_loss(found, truth, 0.85)


@given(st.integers(0, 10_000), st.floats(0, 16), st.floats(0, 16))
def test_crop_displacement_is_the_inverse_of_recovering(seed: int, x: float, y: float) -> None:
    displacement = random_displacement(seed, 40)
    corners = crops((x, y))[0].expand(2, 4, 2)
    recovered = recover_displacement(corners, crop_displacement(corners, displacement))
    assert torch.allclose(recovered, displacement, atol=1e-2)


@pytest.mark.parametrize("found_px", ["all corners in one place", "three in a line", "crossed"])
def test_crops_without_a_homography_still_teach(found_px: str) -> None:
    corners, truth = crops((8.0, 8.0)), shift(10, 10)
    whole = torch.tensor([[0.0, 0.0], [255.0, 0.0], [0.0, 255.0], [255.0, 255.0]])
    places = {
        "all corners in one place": torch.full((4, 2), 100.0),
        "three in a line": torch.tensor([[0.0, 0], [50, 0], [100, 0], [100, 100]]),
        "crossed": whole[[3, 1, 2, 0]] * torch.tensor([[1.0], [1.0], [1.0], [0.999]]),
    }[found_px]
    crop = (places - whole)[None].requires_grad_()
    loss = croptta_loss(torch.cat([truth, crop])[None], truth, corners, 0.85)
    loss.backward()  # type: ignore[no-untyped-call]
    assert math.isfinite(loss.item()) and loss.item() > 1
    assert crop.grad is not None
    assert torch.isfinite(crop.grad).all() and crop.grad.abs().max() > 0


def test_the_gradient_passes_through_the_homography() -> None:
    corners, truth = crops((16.0, 16.0)), shift(10, 10)
    crop = crop_displacement(corners[0], truth) + torch.tensor([0.5, 0.0]) * torch.tensor(
        [[1.0], [-1.0], [1.0], [-1.0]]
    )
    crop = crop.detach().requires_grad_()
    croptta_loss(torch.cat([truth, crop])[None], truth, corners, 1.0).backward()  # type: ignore[no-untyped-call]
    # own corners compared would give 1/8 in x for each; the whole image's corners lie farther out
    assert crop.grad is not None
    assert crop.grad[0, 0, 0] > 0.125 + 1e-3
