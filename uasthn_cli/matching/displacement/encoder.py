"""The feature encoder that both images pass through, at a quarter of their resolution."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from uasthn_cli.matching.displacement.pooling import instance_normalised, max_halved

_IMAGENET_MEAN = (0.485, 0.456, 0.406)
_IMAGENET_DEVIATION = (0.229, 0.224, 0.225)


class ResidualUnit(nn.Module):
    """Two convolutions beside a projection; module names are those of published weights."""

    def __init__(self, channels_in: int, channels: int) -> None:
        """Map ``channels_in`` to ``channels``."""
        super().__init__()
        self.conv1 = nn.Conv2d(channels_in, channels, 3, padding=1)
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1)
        self.downsample = nn.Sequential(nn.Conv2d(channels_in, channels, 1))

    def forward(self, features: Tensor) -> Tensor:
        """``(B, C_in, h, w)`` to ``(B, C, h, w)``."""
        added = _normalised(self.conv2(_normalised(self.conv1(features))))
        projected = instance_normalised(self.downsample(features))
        return functional.relu(projected + added)


class FeatureEncoder(nn.Module):
    """Residual units with instance normalisation and two max-poolings (Cao et al., CVPR 2022)."""

    def __init__(self, block_widths: tuple[int, int], channels: int) -> None:
        """Give the channels of both pairs of units and of the result."""
        super().__init__()
        first, second = block_widths
        self.conv1 = nn.Conv2d(3, first, 7, padding=3)
        self.layer2 = nn.Sequential(ResidualUnit(first, first), ResidualUnit(first, first))
        self.layer3 = nn.Sequential(ResidualUnit(first, second), ResidualUnit(second, second))
        self.conv2 = nn.Conv2d(second, channels, 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, images: Tensor) -> Tensor:
        """Images ``(B, 3, w, w)`` in 0..1 to features ``(B, channels, w / 4, w / 4)``."""
        mean = images.new_tensor(_IMAGENET_MEAN)[:, None, None]
        deviation = images.new_tensor(_IMAGENET_DEVIATION)[:, None, None]
        features = _normalised(self.conv1((images - mean) / deviation))
        features = self.layer2(max_halved(features))
        encoded: Tensor = self.conv2(self.layer3(max_halved(features)))
        return encoded


def _normalised(features: Tensor) -> Tensor:
    return torch.relu_(instance_normalised(features))
