"""Distillation: a small network learns the features of a trained one, no truth needed.

What a score needs of the features is their inner product, and that lives in few dimensions: of the
24 channels of the first networks, 6 keep the scores of real frames to a correlation of 0.9999. The
teacher is therefore first reduced to the channels that the student has, by the truncated singular
value decomposition of the products between map and thermal features.
"""

from collections.abc import Iterable
from copy import deepcopy
from dataclasses import replace

import torch
from torch import Tensor, nn

from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.training.losses import encode_batch

_LEAST_VARIANCE = 1e-9


def reduce_channels(
    model: XcorrModel, batches: Iterable[tuple[Tensor, ...]], channels: int
) -> XcorrModel:
    """Return the same network with fewer feature channels and, as nearly as can be, equal scores.

    ``batches`` yield satellite ``(B, 3, H, W)``, its mask ``(B, 1, H, W)``, thermal
    ``(B, K, 1, h, w)`` and its mask alike. Map and thermal features count as independent of one
    another, so the best reduction follows from their two covariances alone.
    """
    size = model.architecture.feature_channels
    map_power, thermal_power = torch.zeros(2, size, size, dtype=torch.float64)
    with torch.no_grad():
        for batch in batches:
            encoded = encode_batch(model, *batch[:4])
            map_power += _power(encoded[0] - encoded[0].mean(dim=(2, 3), keepdim=True))
            thermal_power += _power(encoded[1])
    to_map, to_thermal = _projections(map_power, thermal_power, channels)
    reduced = deepcopy(model)
    reduced.architecture = replace(model.architecture, feature_channels=channels)
    reduced.satellite_encoder.head = _projected(model.satellite_encoder.head, to_map)
    reduced.thermal_encoder.head = _projected(model.thermal_encoder.head, to_thermal)
    return reduced


def distillation_loss(
    student: tuple[Tensor, Tensor], teacher: tuple[Tensor, Tensor]
) -> tuple[Tensor, Tensor]:
    """Return the loss, and each template's share of unexplained power ``(B · K,)``.

    Both are pairs of :func:`uasthn_cli.training.losses.encode_batch`. Channels are those of
    :func:`reduce_channels`, so each counts by its share in the scores.
    """
    maps = _unexplained(student[0], teacher[0])
    templates = _unexplained(student[1], teacher[1])
    return maps.mean() + templates.mean(), templates.detach()


def _unexplained(student: Tensor, teacher: Tensor) -> Tensor:
    """Return the power of the difference over the teacher's ``(B,)``."""
    power = (teacher**2).flatten(1).sum(dim=1).clamp_min(_LEAST_VARIANCE)
    return ((student - teacher) ** 2).flatten(1).sum(dim=1) / power


def _power(features: Tensor) -> Tensor:
    """Return the second moments ``(C, C)`` of features ``(B, C, h, w)``, their trace 1."""
    flat = features.double().transpose(0, 1).flatten(1)
    moments = flat @ flat.T
    return moments / moments.trace().clamp_min(_LEAST_VARIANCE)


def _projections(map_power: Tensor, thermal_power: Tensor, channels: int) -> tuple[Tensor, Tensor]:
    """Return the matrices ``(channels, C)`` for map and thermal features."""
    left, left_inverse = _root(map_power)
    right, right_inverse = _root(thermal_power)
    u, singular, vh = torch.linalg.svd(left @ right)
    scale = singular[:channels].sqrt()[:, None]
    return scale * (u[:, :channels].T @ left_inverse), scale * (vh[:channels] @ right_inverse)


def _root(power: Tensor) -> tuple[Tensor, Tensor]:
    """Return a positive matrix's root and the root's inverse."""
    values, vectors = torch.linalg.eigh(power)
    roots = (values / values.max()).clamp_min(_LEAST_VARIANCE).sqrt()
    return (vectors * roots) @ vectors.T, (vectors / roots) @ vectors.T


def _projected(head: nn.Conv2d, matrix: Tensor) -> nn.Conv2d:
    """Return a 1 × 1 convolution followed by a matrix ``(channels, C)`` as one convolution."""
    assert head.bias is not None
    projected = nn.Conv2d(head.in_channels, len(matrix), 1)
    with torch.no_grad():
        weight = matrix @ head.weight[:, :, 0, 0].double()
        projected.weight.copy_(weight[:, :, None, None])
        projected.bias.copy_(matrix @ head.bias.double())  # type: ignore[union-attr]
    return projected
