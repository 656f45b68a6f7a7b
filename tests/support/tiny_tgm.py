"""Thermal generation that takes seconds: pairs made up here, generators of four channels."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tiny_training import pattern

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.training.tgm.config import TgmConfig
from uasthn_cli.training.tgm.generators import (
    GeneratorArchitecture,
    GeneratorKind,
    build_generator,
)
from uasthn_cli.training.tgm.thermal_generator import ThermalGenerator
from uasthn_cli.training.tgm.weights import TrainedGenerator, serialise_generator

TINY_UNET = GeneratorArchitecture(GeneratorKind.UNET, width=4, levels=5)
TINY_RESNET = GeneratorArchitecture(GeneratorKind.RESNET, width=4, blocks=1)


def tiny_tgm_config(**changes: Any) -> TgmConfig:
    """Return four steps on images of 64 px with a checkpoint after every second."""
    settings: dict[str, Any] = {
        "steps": 4,
        "size_px": 64,
        "jitter_px": 6,
        "checkpoint_every": 2,
        "architecture": TINY_UNET,
        "discriminator_width": 4,
    }
    return TgmConfig(**(settings | changes))


def pair(seed: int, shift_px: float = 20.0, thermal_px: int = 80) -> MatchSample:
    """Return a pair whose thermal image is the inverted red of the satellite, seen upright."""
    red = pattern(seed, 160, 160, 6.0)
    satellite = np.stack([red, pattern(seed + 100, 160, 160), red**2], axis=-1)
    first = int(shift_px)
    seen = 1.0 - red[first : first + thermal_px, first : first + thermal_px]
    return MatchSample(
        name=f"pair {seed}",
        satellite=(satellite * 255).astype(np.uint8),
        thermal=(seen * 255).astype(np.uint8),
        corners_px=image_corners_px(thermal_px, thermal_px) + first,
        satellite_gsd_m=2.0,
    )


@dataclass(frozen=True, slots=True)
class ListedPairs:
    """A data set in memory."""

    samples: Sequence[MatchSample]

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.samples)

    def __getitem__(self, index: int) -> MatchSample:
        """Return a sample."""
        return self.samples[index]


def listed_pairs(count: int = 3, first: int = 0) -> ListedPairs:
    """Return a few pairs."""
    return ListedPairs([pair(first + seed) for seed in range(count)])


def tiny_trained(
    architecture: GeneratorArchitecture = TINY_UNET, size_px: int = 64, gsd_m: float = 2.0
) -> TrainedGenerator:
    """Return an untrained generator whose images show a good range of grey all the same."""
    torch.manual_seed(3)
    network = build_generator(architecture)
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.ndim > 1:
                parameter.mul_(6.0)
    return TrainedGenerator(network.eval(), architecture, size_px, gsd_m)


def tiny_generator(**settings: Any) -> ThermalGenerator:
    """Return a generator at work."""
    return ThermalGenerator(tiny_trained(**settings))


def write_tiny_generator(path: Path, **settings: Any) -> Path:
    """Write the weights of a generator."""
    path.write_bytes(serialise_generator(tiny_trained(**settings), {}))
    return path
