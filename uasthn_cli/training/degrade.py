"""What cameras and time do to both images: sensor, exposure, map edges, things that changed."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.fields import blur, standardise
from uasthn_cli.types import ImageArray

_EDGE_SHARE = 0.15

_BLUR_PX = (0.3, 1.0)
_MAX_DRIFT, _MAX_NOISE, _MAX_STRIPES = 1.0, 0.12, 0.15
"""In deviations of the scene, at the width at which the network sees a frame.

Real frames, most of whose noise is averaged away there, measure 0.26 to 0.81, 0.01 to 0.07 and 0.01
to 0.08, their scenes' own structure included (``benchmarks/sensor_statistics.py``).
"""


def degrade_thermal(
    rng: np.random.Generator, thermal: NDArray[Any], valid: ImageArray, engine: EngineConfig
) -> ImageArray:
    """Return a rectified thermal frame as a camera would give it; 0 where not valid.

    With the engine's ``sensor``: optics blur, slow gradients (vignetting, narcissus), noise,
    stripes, saturation by automatic gain, objects that are not on the map.
    """
    thermal = _through_sensor(rng, thermal) if engine.sensor else standardise(thermal)
    return np.asarray(thermal * valid, dtype=np.float32)


def degrade_map(rng: np.random.Generator, rgb: ImageArray, engine: EngineConfig) -> ImageArray:
    """Return the map, by the engine under another exposure, balance and sharpness; in 0..1."""
    if not engine.map_appearance:
        return rgb
    if rng.random() < 0.8:
        contrast, brightness = rng.uniform(0.6, 1.5), rng.normal() * 0.1
        rgb = np.clip((rgb - 0.5) * contrast + 0.5 + brightness, 0, 1) * rng.uniform(0.8, 1.2, 3)
    if rng.random() < 0.2:
        rgb = blur(rgb.astype(np.float32), rng.uniform(0.4, 1.2))
    if rng.random() < 0.1:
        rgb = np.repeat(rgb.mean(axis=-1, keepdims=True), 3, axis=-1)
    rgb = rgb + rng.uniform(0, 0.01) * rng.standard_normal(rgb.shape, dtype=np.float32)
    return np.clip(rgb, 0, 1).astype(np.float32)


def map_edge(rng: np.random.Generator, size_px: int) -> ImageArray:
    """Return the part of a window that the map covers: all, or up to an edge of the map."""
    covered = np.ones((size_px, size_px), np.float32)
    if rng.random() < _EDGE_SHARE:
        depth_px = int(rng.uniform(0.05, 0.4) * size_px)
        covered[:depth_px] = 0
        covered = np.ascontiguousarray(np.rot90(covered, int(rng.integers(4))))
    return covered


def _through_sensor(rng: np.random.Generator, thermal: NDArray[Any]) -> NDArray[Any]:
    """Return what a sensor makes of a scene's temperatures."""
    if rng.random() < 0.8:
        thermal = blur(thermal, rng.uniform(*_BLUR_PX))
    height, width = thermal.shape
    thermal = (thermal - thermal.mean()) / (thermal.std() + 1e-4)
    knots = rng.standard_normal((3, 3), dtype=np.float32)
    drift = cv2.resize(knots, (width, height), interpolation=cv2.INTER_CUBIC)
    thermal = thermal + np.float32(rng.uniform(0, _MAX_DRIFT)) * drift
    noise = rng.standard_normal(thermal.shape, dtype=np.float32)
    if rng.random() < 0.5:
        noise = 2 * blur(noise, rng.uniform(0.5, 1.0))
    thermal = thermal + np.float32(rng.uniform(0, _MAX_NOISE)) * noise
    if rng.random() < 0.3:
        shape = (1, width) if rng.random() < 0.5 else (height, 1)
        stripes = rng.standard_normal(shape, dtype=np.float32)
        thermal = thermal + np.float32(rng.uniform(0, _MAX_STRIPES)) * stripes
    if rng.random() < 0.35:
        _add_objects(rng, thermal)
    if rng.random() < 0.3:
        low, high = np.percentile(thermal, (rng.uniform(0, 5), rng.uniform(93, 100)))
        thermal = np.clip(thermal, low, high)
    return thermal


def _add_objects(rng: np.random.Generator, thermal: ImageArray) -> None:
    """Draw things of another date: vehicles, herds, a burnt or watered patch (in place)."""
    height, width = thermal.shape
    for _ in range(int(rng.integers(1, 4))):
        corner = rng.integers(0, (width, height))
        size = rng.integers(3, 16, 2)
        box = ((float(corner[0]), float(corner[1])), (float(size[0]), float(size[1])))
        polygon = cv2.boxPoints((*box, float(rng.uniform(0, 180)))).astype(np.int32)
        cv2.fillConvexPoly(thermal, polygon, float(rng.normal() * 1.5))
