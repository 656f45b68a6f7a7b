"""The lookup of correlations, against sampling one place at a time."""

import torch
from torch import Tensor
from torch.nn import functional

from uasthn_cli.matching.displacement.correlation import (
    CHANNELS_PER_LEVEL,
    RADIUS,
    CorrelationPyramid,
)


def features(count: int, seed: int) -> Tensor:
    torch.manual_seed(seed)
    return torch.randn(count, 6, 12, 12)


def one_by_one(images: Tensor, places: Tensor) -> Tensor:
    """Sample images ``(n, h, w)`` around places ``(n, 2)`` with torch's own bilinear sampling."""
    steps = torch.arange(-RADIUS, RADIUS + 1.0)
    offsets = torch.stack(torch.meshgrid(steps, steps, indexing="ij"), dim=-1)
    last = torch.tensor([images.shape[2] - 1, images.shape[1] - 1])
    grid = 2.0 * (places[:, None, None] + offsets) / last - 1.0
    sampled = functional.grid_sample(images[:, None], grid, align_corners=True)
    return sampled.reshape(len(images), -1)


def test_a_lookup_is_bilinear_sampling_of_every_level() -> None:
    pyramid = CorrelationPyramid.of(features(1, 0), features(2, 1), 2)
    torch.manual_seed(2)
    places = torch.rand(2, 12, 12, 2) * 24.0 - 6.0
    found = pyramid.look_up(places)
    assert found.shape == (2, 2 * CHANNELS_PER_LEVEL, 12, 12)
    for number, level in enumerate(pyramid.levels):
        expected = one_by_one(level.flatten(0, 1), places.reshape(-1, 2) / 2**number)
        channels = slice(number * CHANNELS_PER_LEVEL, (number + 1) * CHANNELS_PER_LEVEL)
        of_level = found[:, channels].movedim(1, -1).reshape(-1, CHANNELS_PER_LEVEL)
        assert torch.allclose(of_level, expected, atol=1e-3)


def test_correlations_are_products_of_features_and_not_negative() -> None:
    satellite, thermal = features(1, 3), features(1, 4)
    pyramid = CorrelationPyramid.of(satellite, thermal, 1)
    product = (satellite[0, :, 2, 5] * thermal[0, :, 7, 1]).sum()
    assert torch.isclose(pyramid.levels[0][0, 2 * 12 + 5, 7, 1], product.clamp_min(0.0), atol=1e-5)
    assert float(pyramid.levels[0].min()) == 0.0


def test_views_share_satellite_features_in_the_stated_order() -> None:
    satellite, thermal = features(2, 5), features(6, 6)
    together = CorrelationPyramid.of(satellite, thermal, 2)
    for number in range(6):
        sample = number % 2
        alone = CorrelationPyramid.of(
            satellite[sample : sample + 1], thermal[number : number + 1], 2
        )
        for ours, theirs in zip(together.levels, alone.levels, strict=True):
            assert torch.allclose(ours[number : number + 1], theirs, atol=1e-5)


def test_outside_and_nowhere_there_is_nothing() -> None:
    pyramid = CorrelationPyramid.of(features(1, 7), features(1, 8), 2)
    for place in (-1e9, 40.0, float("inf"), float("nan")):
        assert float(pyramid.look_up(torch.full((1, 12, 12, 2), place)).abs().max()) == 0.0
