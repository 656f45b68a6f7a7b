"""Pairs and runs for displacement networks that take seconds: small images, small networks."""

from typing import Any

import cv2
import numpy as np
from tiny_training import pattern
from torch import Tensor, nn

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px
from uasthn_cli.matching.displacement.network import Refinement
from uasthn_cli.training.displacement.config import DisplacementConfig
from uasthn_cli.types import FloatArray

SATELLITE_PX, THERMAL_PX = 300, 100


def pattern_sample(seed: int, corners_px: FloatArray) -> MatchSample:
    """Return a pattern, and as thermal image what lies between these corners of it."""
    grey = np.asarray(255 * pattern(seed, SATELLITE_PX, SATELLITE_PX), np.uint8)
    H = homography_from_corners(image_corners_px(THERMAL_PX, THERMAL_PX), corners_px)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(grey, H, (THERMAL_PX, THERMAL_PX), flags=flags)
    colour = np.repeat(grey[..., None], 3, axis=2)
    return MatchSample(f"{seed}", colour, np.asarray(seen, np.uint8), corners_px, 1.0)


class PatternPairs:
    """Upright thermal images at random places of patterns."""

    def __init__(self, count: int, first_seed: int = 0) -> None:
        """Make ``count`` of them when asked for."""
        self._count, self._first_seed = count, first_seed

    def __len__(self) -> int:
        """Return their number."""
        return self._count

    def __getitem__(self, index: int) -> MatchSample:
        """Return one."""
        seed = self._first_seed + index
        shift_px = np.random.default_rng(seed).uniform(60, 140, 2)
        return pattern_sample(seed, image_corners_px(THERMAL_PX, THERMAL_PX) + shift_px)


class TinyLocator(nn.Module):
    """Regresses corners from both images by strided convolutions, each iteration a half step."""

    def __init__(self) -> None:
        """Build it with random weights."""
        super().__init__()
        self.layers = nn.Sequential(
            nn.AvgPool2d(4),
            nn.Conv2d(6, 8, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(8, 8, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.AdaptiveAvgPool2d(4),
            nn.Flatten(),
            nn.Dropout(0.1),
            nn.Linear(128, 8),
        )

    def forward(self, satellite: Tensor, thermal: Tensor, iterations: int) -> Refinement:
        """Return ``iterations`` displacements that approach the last one."""
        repeats = len(thermal) // len(satellite)
        both = thermal.new_empty(len(thermal), 6, *thermal.shape[2:])
        both[:, :3], both[:, 3:] = satellite.repeat(repeats, 1, 1, 1), thermal
        found = 64 * self.layers(both).reshape(-1, 4, 2)
        shares = [1 - 0.5 ** (step + 1) for step in range(iterations)]
        return Refinement(found.new_tensor(shares)[:, None, None, None] * found)


def tiny_displacement_config(**changes: Any) -> DisplacementConfig:
    """Return four steps with a checkpoint after every second, in one process."""
    settings: dict[str, Any] = {
        "network": "ihn",
        "steps": 4,
        "batch": 2,
        "iterations": 2,
        "fine_iterations": 1,
        "workers": 0,
        "checkpoint_every": 2,
        "fine_satellite_px": SATELLITE_PX,
    }
    return DisplacementConfig(**(settings | changes))
