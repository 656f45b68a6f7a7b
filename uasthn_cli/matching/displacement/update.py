"""From correlations to a step of the four corners."""

import torch
from torch import Tensor, nn

from uasthn_cli.matching.displacement.pooling import MaxHalved

_POOLED = 5
"""Layers that halve the resolution: from 64 by 64 cells to one value for each corner."""


class UpdateBlock(nn.Module):
    """Convolutions, each pooled, down to two by two cells (Cao et al., CVPR 2022)."""

    def __init__(self, channels_in: int, channels: int) -> None:
        """Take ``channels_in`` (correlations and flow) and work in ``channels``."""
        super().__init__()
        self.cnn = nn.Module()
        for number in range(1, _POOLED + 1):
            layer = nn.Sequential(*_unit(channels_in, channels), MaxHalved())
            self.cnn.add_module(f"layer{number}", layer)
            channels_in = channels
        last = nn.Sequential(*_unit(channels, channels), nn.Conv2d(channels, 2, 1))
        self.cnn.add_module("layer10", last)

    def forward(self, correlations: Tensor, flow: Tensor) -> Tensor:
        """Correlations ``(B, C, h, w)`` and flow ``(B, h, w, 2)`` to corners' steps ``(B, 4, 2)``.

        The flow is how far a place lies from its cell, in cells.
        """
        features = torch.cat([correlations, flow.movedim(-1, 1).to(correlations.dtype)], dim=1)
        for layer in self.cnn.children():
            features = layer(features)
        return features.flatten(2).mT


def _unit(channels_in: int, channels: int) -> tuple[nn.Module, ...]:
    return (
        nn.Conv2d(channels_in, channels, 3, padding=1),
        nn.GroupNorm(channels // 8, channels),
        nn.ReLU(inplace=True),
    )
