"""Pooling and normalisation are torch's own, whatever the way there."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.nn import functional

from uasthn_cli.matching.displacement.pooling import (
    MaxHalved,
    instance_normalised,
    max_halved,
    mean_halved,
)

SIDES = st.integers(1, 9)


def images(height: int, width: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(2, 3, height, width, generator=generator) * 5.0 + 40.0


@given(rows=SIDES, columns=SIDES, wants_gradient=st.booleans())
def test_halves_are_those_of_torch(rows: int, columns: int, wants_gradient: bool) -> None:
    wide = images(2 * rows, 2 * columns)
    with torch.set_grad_enabled(wants_gradient):
        assert torch.equal(max_halved(wide), functional.max_pool2d(wide, 2))
        assert torch.equal(MaxHalved()(wide), functional.max_pool2d(wide, 2))
        assert torch.allclose(mean_halved(wide), functional.avg_pool2d(wide, 2))


def test_other_memory_layouts_are_pooled_too() -> None:
    wide = images(6, 10).to(memory_format=torch.channels_last)
    with torch.inference_mode():
        assert torch.equal(max_halved(wide), functional.max_pool2d(wide, 2))


@pytest.mark.parametrize("size", [(4, 6), (31, 8)])
def test_channels_are_normalised_as_by_torch(size: tuple[int, int]) -> None:
    expected = functional.instance_norm(images(*size))
    with torch.inference_mode():
        assert torch.allclose(instance_normalised(images(*size)), expected, atol=1e-5)
    with_gradient = images(*size).requires_grad_()
    assert torch.allclose(instance_normalised(with_gradient), expected, atol=1e-5)


def test_an_even_channel_stays_finite() -> None:
    with torch.inference_mode():
        assert torch.equal(
            instance_normalised(torch.full((1, 2, 4, 4), 7.0)), torch.zeros(1, 2, 4, 4)
        )


@pytest.mark.parametrize("layer", [max_halved, mean_halved, instance_normalised])
def test_gradients_flow(layer: object) -> None:
    assert callable(layer)
    wide = images(4, 4).double().requires_grad_()
    assert torch.autograd.gradcheck(layer, (wide,))
