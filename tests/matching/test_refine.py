"""The refiner: corners from a known warp, and corners that define none."""

import pytest
import torch

from uasthn_cli.geometry.corners import DegenerateHomographyError
from uasthn_cli.matching.refine import Refiner, apply_homography, homography

SQUARE = torch.tensor([[[0.0, 0.0], [29.0, 0.0], [0.0, 21.0], [29.0, 21.0]]])


def test_homography_takes_corners_to_corners() -> None:
    target = SQUARE + torch.tensor([[[1.0, 2.0], [-0.5, 1.0], [0.3, -1.0], [2.0, 0.5]]])
    H = homography(SQUARE, target)
    assert torch.allclose(apply_homography(H, SQUARE), target, atol=1e-4)


def test_corners_in_one_point_define_no_homography() -> None:
    with pytest.raises(DegenerateHomographyError):
        homography(torch.zeros_like(SQUARE), SQUARE)


def test_an_untrained_refiner_already_moves_corners_towards_a_shift() -> None:
    """Its last layer is zero, so it is a soft-argmax of patch correlation (non-square template)."""
    generator = torch.Generator().manual_seed(3)
    window = torch.randn(1, 8, 60, 70, generator=generator)
    template = window[:, :, 14:36, 20:50].clone()
    true = SQUARE + torch.tensor([20.0, 14.0])
    start = true + torch.tensor([2.0, -1.0])
    mask = torch.ones(1, 1, 22, 30)
    with torch.no_grad():
        found = Refiner()(window, template, mask, start, 3)[-1]
    before, after = (c - true for c in (start, found))
    assert after.norm(dim=-1).mean() < 0.3 * before.norm(dim=-1).mean()
