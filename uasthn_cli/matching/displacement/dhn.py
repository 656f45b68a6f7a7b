"""DHN: one regression of the four corners from both images (DeTone et al. 2016)."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.matching.displacement.network import Refinement
from uasthn_cli.matching.displacement.pooling import MaxHalved

_POOLED = 5
"""Layers that halve the resolution: from 256 pixels to 8 cells."""

_UNIT_PX = RESIZED_WIDTH_PX / 8
"""What an output of 1 stands for: the network regresses numbers near 1."""


@dataclass(frozen=True, slots=True)
class DhnArchitecture:
    """Size of a DHN: channels of its five pairs of convolutions, and of its hidden layer.

    ``has_uncertainty_head`` adds a second head of the same size for Direct Modeling.
    """

    widths: tuple[int, int, int, int, int] = (32, 64, 64, 128, 128)
    hidden: int = 1024
    has_uncertainty_head: bool = False

    def as_metadata(self) -> dict[str, Any]:
        """Return the architecture as JSON can hold it."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class StackedImages:
    """Satellite and thermal images as one ``(B, 6, 256, 256)``."""

    images: Tensor

    def first(self, count: int) -> "StackedImages":
        """Return the first ``count`` pairs."""
        return StackedImages(self.images[:count])


class DirectHomographyNetwork(nn.Module):
    """DeTone's net with a fifth pair of layers, for 256 pixels instead of 128, both in colour.

    Group normalisation replaces that of batches: an answer must not depend on its neighbours.
    """

    is_iterative = False

    def __init__(self, architecture: DhnArchitecture | None = None) -> None:
        """Build a network with random weights."""
        super().__init__()
        self.architecture = architecture = architecture or DhnArchitecture()
        layers: list[nn.Module] = []
        channels_in = 6
        for width in architecture.widths:
            layers += [*_unit(channels_in, width), *_unit(width, width), MaxHalved()]
            channels_in = width
        self.features = nn.Sequential(*layers)
        inputs = channels_in * (RESIZED_WIDTH_PX >> _POOLED) ** 2
        self.head = _head(inputs, architecture.hidden)
        if architecture.has_uncertainty_head:
            self.ue_head = _head(inputs, architecture.hidden)

    def encode_satellite(self, satellite: Tensor) -> Tensor:
        """Return the images themselves: this network has no satellite branch to share."""
        return satellite

    def pair(self, satellite_features: Tensor, thermal: Tensor) -> StackedImages:
        """Stack B satellite images with ``N * B`` thermal ones."""
        repeats = len(thermal) // len(satellite_features)
        return StackedImages(torch.cat([satellite_features.repeat(repeats, 1, 1, 1), thermal], 1))

    def refine(
        self,
        pairing: StackedImages,
        iterations: int = 1,
        start: Tensor | None = None,
        *,
        is_lookup_held: bool = False,
    ) -> Refinement:
        """Return the one displacement ``(1, B, 4, 2)`` there is (K = 1 in the paper).

        Raises:
            ValueError: it should go on from a displacement.
        """
        if start is not None:
            raise ValueError("DHN regresses once: it cannot go on from a displacement")
        features = self.features(pairing.images - 0.5)
        displacements = self.head(features).reshape(1, -1, 4, 2) * _UNIT_PX
        if not self.architecture.has_uncertainty_head:
            return Refinement(displacements)
        log_variances = self.ue_head(features).reshape(1, -1, 4, 2) + 2.0 * math.log(_UNIT_PX)
        return Refinement(displacements, log_variances)

    def forward(self, satellite: Tensor, thermal: Tensor, iterations: int = 1) -> Refinement:
        """Locate thermal images ``(N * B, 3, 256, 256)`` in satellite images of the same kind."""
        return self.refine(self.pair(satellite, thermal), iterations)


def _head(inputs: int, hidden: int) -> nn.Sequential:
    """Return fully connected layers to eight numbers, two of each corner."""
    return nn.Sequential(
        nn.Flatten(),
        nn.Dropout(0.5),
        nn.Linear(inputs, hidden),
        nn.ReLU(inplace=True),
        nn.Linear(hidden, 8),
    )


def _unit(channels_in: int, channels: int) -> tuple[nn.Module, ...]:
    convolution = nn.Conv2d(channels_in, channels, 3, padding=1)
    # eight channels a group, as in the update block of IHN
    return convolution, nn.GroupNorm(max(1, channels // 8), channels), nn.ReLU(inplace=True)
