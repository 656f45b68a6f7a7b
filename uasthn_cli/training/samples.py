"""Draw training samples: a map window, thermal canvases over it, and where they truly lie."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from torch.utils.data import Dataset

from uasthn_cli.config import TrainingDefaults
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px
from uasthn_cli.training.degrade import degrade_map, degrade_thermal, map_edge
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.scenes import SceneSet
from uasthn_cli.types import FloatArray, ImageArray

_DEFAULTS = TrainingDefaults()
WINDOW_PX = 256
CANVAS_PX = 112


@dataclass(frozen=True, slots=True)
class SampleConfig:
    """Size of a batch, strength of the prior's geometric error, and what the engine does."""

    windows: int = _DEFAULTS.windows
    canvases: int = _DEFAULTS.canvases
    yaw_error_deg: float = 2.5
    scale_error: float = 0.04
    corner_error_px: float = 1.0
    engine: EngineConfig = field(default_factory=EngineConfig)


@dataclass(frozen=True, slots=True)
class Batch:
    """``B`` windows with ``K`` thermal canvases each.

    ``satellite`` ``(B, 3, 256, 256)``, ``satellite_valid`` ``(B, 1, 256, 256)``, ``thermal``
    ``(B, K, 1, 112, 112)``, ``thermal_valid`` alike, ``corners_px`` ``(B, K, 4, 2)``: corners of
    the canvas in window pixels.
    """

    satellite: ImageArray
    satellite_valid: ImageArray
    thermal: ImageArray
    thermal_valid: ImageArray
    corners_px: NDArray[np.float32]


class SampleDataset(Dataset[Batch]):
    """Batches by number: the same seed and number give the same batch in any worker."""

    def __init__(self, scenes: SceneSet, config: SampleConfig, *, seed: int, batches: int) -> None:
        """Provide ``batches`` batches."""
        self._scenes, self._config, self._seed, self._batches = scenes, config, seed, batches

    def __len__(self) -> int:
        """Return the number of batches."""
        return self._batches

    def __getitem__(self, index: int) -> Batch:
        """Render batch ``index``."""
        rng = np.random.default_rng([self._seed, index])
        windows = [
            _draw_window(rng, self._scenes, self._config) for _ in range(self._config.windows)
        ]
        columns = [np.stack(column) for column in zip(*windows, strict=True)]
        return Batch(*columns)


def _draw_window(
    rng: np.random.Generator, scenes: SceneSet, config: SampleConfig
) -> tuple[ImageArray, ImageArray, ImageArray, ImageArray, NDArray[np.float32]]:
    """Return one window and its canvases, laid out as in :class:`Batch` without the first axis."""
    scene = scenes.draw(rng)
    height_px, width_px = scene.shape_px
    length_px = _draw_length_px(rng, min(height_px, width_px), config.engine)
    row_px = int(rng.integers(0, height_px - length_px + 1))
    column_px = int(rng.integers(0, width_px - length_px + 1))
    rgb, fields = scene.render(rng, row_px, column_px, length_px, WINDOW_PX, config.engine)
    turns, mirrored = int(rng.integers(4)), rng.random() < 0.5
    rgb, *fields = [_turn(image, turns, mirrored=mirrored) for image in (rgb, *fields)]
    edge = map_edge(rng, WINDOW_PX)
    canvases = [
        _draw_canvas(rng, fields[k % len(fields)], config, edge) for k in range(config.canvases)
    ]
    thermal, valid, corners = (np.stack(column) for column in zip(*canvases, strict=True))
    satellite = degrade_map(rng, rgb, config.engine) * edge[..., None]
    return (
        np.ascontiguousarray(satellite.transpose(2, 0, 1), dtype=np.float32),
        edge[None],
        thermal[:, None],
        valid[:, None],
        corners,
    )


def _draw_length_px(rng: np.random.Generator, shorter_px: int, engine: EngineConfig) -> int:
    """Return the side of the square to cut out of a scene whose shorter side is ``shorter_px``."""
    if not engine.scale_range:
        return min(shorter_px, WINDOW_PX)
    longest_px = shorter_px if rng.random() < 0.7 else min(shorter_px, 3 * WINDOW_PX)
    return int(rng.uniform(min(160, longest_px), longest_px + 1))


def _draw_canvas(
    rng: np.random.Generator, field: ImageArray, config: SampleConfig, edge: ImageArray
) -> tuple[ImageArray, ImageArray, NDArray[np.float32]]:
    """Return a thermal canvas, its mask, and the canvas's corners in the window."""
    corners = _true_corners(rng, config, edge)
    H_canvas_window = homography_from_corners(image_corners_px(CANVAS_PX, CANVAS_PX), corners)
    thermal = cv2.warpPerspective(
        field,
        H_canvas_window,
        (CANVAS_PX, CANVAS_PX),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REFLECT,
    )
    valid = _footprint(rng)
    return degrade_thermal(rng, thermal, valid, config.engine), valid, corners.astype(np.float32)


def _true_corners(rng: np.random.Generator, config: SampleConfig, edge: ImageArray) -> FloatArray:
    """Return where a canvas lies: inside the window, its centre on the map, a prior's error off."""
    half = (CANVAS_PX - 1) / 2
    for _ in range(20):
        centre = rng.uniform(half + 2, WINDOW_PX - 1 - half - 2, 2)
        if edge[int(centre[1]), int(centre[0])] > 0:
            break
    strength = 1.0 if config.engine.geometry_error else 0.0
    yaw = np.deg2rad(rng.normal() * strength * config.yaw_error_deg)
    rotation = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    square = image_corners_px(CANVAS_PX, CANVAS_PX) - half
    scale = np.exp(rng.normal() * strength * config.scale_error)
    corners: FloatArray = scale * square @ rotation.T + centre
    return corners + rng.normal(size=(4, 2)) * strength * config.corner_error_px


def _footprint(rng: np.random.Generator) -> ImageArray:
    """Return the mask of a turned frame on the canvas: what a rectified frame looks like."""
    width = rng.uniform(60, 104)
    height = width * rng.choice([0.8, 0.75, 0.5625])
    yaw_deg = rng.choice([0.0, 90.0]) + rng.normal() * 5
    if rng.random() < 0.5:
        yaw_deg = rng.uniform(0, 180)
    centre = (CANVAS_PX - 1) / 2
    box = cv2.boxPoints(((centre, centre), (width, height), float(yaw_deg)))
    mask = np.zeros((CANVAS_PX, CANVAS_PX), np.float32)
    cv2.fillConvexPoly(mask, np.round(box).astype(np.int32), 1.0)
    return mask


def _turn(image: ImageArray, turns: int, *, mirrored: bool) -> ImageArray:
    turned = np.rot90(image, turns)
    return np.ascontiguousarray(turned[:, ::-1] if mirrored else turned, dtype=np.float32)
