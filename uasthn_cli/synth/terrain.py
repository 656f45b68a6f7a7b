"""The shape of bare ground, and what light and night make of it."""

import math

import cv2
import numpy as np

from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.types import ImageArray

_SHADOW_REACH_M = 60.0


def hills(
    rng: np.random.Generator,
    shape: tuple[int, int],
    gsd_m: float,
    *,
    wavelength_m: float,
    relief_m: float,
) -> ImageArray:
    """Return gentle hills ``(h, w)`` in metres with a deviation of ``relief_m``."""
    return relief_m * fractal_noise(
        rng, shape, gsd_m, wavelength_m, roughness=0.42, finest_m=max(2.0 * gsd_m, 2.0)
    )


def slopes(height_m: ImageArray, gsd_m: float) -> tuple[ImageArray, ImageArray]:
    """Return the rise per metre towards the east and towards the north, ``(h, w)`` each."""
    kernel = np.array([[-0.5, 0.0, 0.5]], dtype=np.float32) / gsd_m
    east = cv2.filter2D(height_m, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    south = cv2.filter2D(height_m, cv2.CV_32F, kernel.T, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(east, np.float32), np.asarray(-south, np.float32)


def sunlight(
    height_m: ImageArray, gsd_m: float, azimuth_rad: float, elevation_rad: float
) -> ImageArray:
    """Return direct light ``(h, w)`` on the ground, 1 on flat ground, 0 where the sun is behind.

    Lambert's law for the surface normal ``(-dh/de, -dh/dn, 1)``.
    """
    east, north = slopes(height_m, gsd_m)
    toward_e, toward_n = math.sin(azimuth_rad), math.cos(azimuth_rad)
    facing = 1.0 - (east * toward_e + north * toward_n) / math.tan(elevation_rad)
    light = facing / np.sqrt(1.0 + east * east + north * north)
    return np.asarray(np.clip(light, 0.0, 2.0), dtype=np.float32)


def cast_shadow(
    above_m: ImageArray, gsd_m: float, azimuth_rad: float, elevation_rad: float
) -> ImageArray:
    """Return how deep ``(h, w)`` each pixel lies in the shadow of objects, 0 (sun) to 1.

    The height field is carried along the sun's ray pixel by pixel, losing height as the ray falls.
    """
    reach_m = min(_SHADOW_REACH_M, float(above_m.max()) / math.tan(elevation_rad))
    steps = math.ceil(reach_m / gsd_m)
    away_x, away_y = -math.sin(azimuth_rad), math.cos(azimuth_rad)
    drop_m = math.tan(elevation_rad) * gsd_m
    roof = np.zeros_like(above_m)
    for step in range(1, steps + 1):
        dx, dy = round(step * away_x), round(step * away_y)
        target, source = _shifted_windows(above_m.shape, dx, dy)
        np.maximum(roof[target], above_m[source] - step * drop_m, out=roof[target])
    depth = (roof - above_m) / np.float32(max(0.5, drop_m))
    return np.asarray(np.clip(depth, 0.0, 1.0), dtype=np.float32)


def hollowness(height_m: ImageArray, gsd_m: float, scale_m: float) -> ImageArray:
    """Return how far ``(h, w)`` each point lies below its surroundings, in metres."""
    return smooth(height_m, scale_m / gsd_m) - height_m


def _shifted_windows(
    shape: tuple[int, ...], dx: int, dy: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the windows ``(target, source)`` of an image moved by ``(dx, dy)`` pixels."""
    height, width = shape[0], shape[1]
    target = (
        slice(max(0, dy), max(0, min(height, height + dy))),
        slice(max(0, dx), max(0, min(width, width + dx))),
    )
    source = (
        slice(max(0, -dy), max(0, min(height, height - dy))),
        slice(max(0, -dx), max(0, min(width, width - dx))),
    )
    return target, source
