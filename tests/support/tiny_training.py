"""Trainings that take seconds: a network of four channels, batches of two, scenes made up here."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.samples import SampleConfig
from uasthn_cli.training.scenes import SceneSet
from uasthn_cli.training.trainee import TrainingConfig
from uasthn_cli.types import ImageArray

TINY_ARCHITECTURE = XcorrArchitecture(feature_channels=4, widths=(4, 4, 4, 4))
TINY_SAMPLES = SampleConfig(windows=2, canvases=1)


def tiny_config(**changes: Any) -> TrainingConfig:
    """Return four steps with a checkpoint after every second, in one process."""
    settings: dict[str, Any] = {
        "steps": 4,
        "checkpoint_every": 2,
        "bfloat16": False,
        "workers": 0,
        "samples": TINY_SAMPLES,
        "architecture": TINY_ARCHITECTURE,
    }
    return TrainingConfig(**(settings | changes))


def pattern(seed: int, height_px: int, width_px: int, sigma_px: float = 3.0) -> ImageArray:
    """Return smooth random structure in 0..1 that looks like itself nowhere else."""
    noise = np.random.default_rng(seed).standard_normal((height_px, width_px), dtype=np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), sigma_px)
    low, high = float(smooth.min()), float(smooth.max())
    return np.asarray((smooth - low) / (high - low), dtype=np.float32)


@dataclass(frozen=True, slots=True)
class PatternScene:
    """A scene whose map and thermal views show the same pattern: ground truth is what one sees."""

    seed: int = 0
    shape_px: tuple[int, int] = (300, 420)

    def identity(self) -> bytes:
        """Return which pattern this is."""
        return f"pattern {self.seed}".encode()

    def render(
        self,
        rng: np.random.Generator,
        row_px: int,
        column_px: int,
        length_px: int,
        size_px: int,
        engine: EngineConfig,
    ) -> tuple[ImageArray, list[ImageArray]]:
        """Return the pattern as a grey map and as both thermal views."""
        whole = pattern(self.seed, *self.shape_px)
        piece = whole[row_px : row_px + length_px, column_px : column_px + length_px]
        seen = np.asarray(cv2.resize(piece, (size_px, size_px)), dtype=np.float32)
        return np.repeat(seen[..., None], 3, axis=-1), [seen, seen.copy()]


def pattern_scenes(count: int = 2) -> SceneSet:
    """Return patterns, each as likely as the others."""
    scenes = tuple(PatternScene(seed) for seed in range(count))
    return SceneSet(scenes, np.full(count, 1 / count))


def write_photo(path: Path, seed: int = 0, height_px: int = 180, width_px: int = 220) -> Path:
    """Write a colour photograph of nothing in particular, PNG or JPEG by its name."""
    planes = [pattern(3 * seed + band, height_px, width_px) for band in range(3)]
    pixels: NDArray[np.uint8] = (np.stack(planes, axis=-1) * 255).astype(np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels)
    return path
