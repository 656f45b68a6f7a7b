"""Small pieces that every source of pairs is made of: offsets, squares, 8-bit images."""

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.types import BoolArray, FloatArray, ImageArray

_ROBUST_PERCENT = (0.5, 99.5)


def sample_rng(seed: int, index: int, name: str = "") -> np.random.Generator:
    """Return the random numbers of one sample, whatever was drawn before it."""
    return np.random.default_rng([seed, index, zlib.crc32(name.encode())])


def draw_offset_m(rng: np.random.Generator, max_offset_m: float) -> FloatArray:
    """Return ``(x, y)`` metres, evenly spread over the disc of radius D_C (paper, sec. IV)."""
    radius_m = max_offset_m * np.sqrt(rng.random())
    angle_rad = rng.uniform(0.0, 2.0 * np.pi)
    return np.asarray(radius_m * np.array([np.cos(angle_rad), np.sin(angle_rad)]))


def square_corners_px(side_px: int, centre_px: FloatArray) -> FloatArray:
    """Return the corner pixels ``(4, 2)`` of an upright square about ``centre_px`` ``(2,)``."""
    return image_corners_px(side_px, side_px) - (side_px - 1) / 2 + centre_px


def cut_square(image: NDArray[Any], first_px: tuple[int, int], side_px: int) -> NDArray[Any]:
    """Return the square of an image that starts at ``(x, y)``, 0 beyond the image's edges."""
    x, y = first_px
    height_px, width_px = image.shape[:2]
    square = np.zeros((side_px, side_px, *image.shape[2:]), image.dtype)
    top, bottom = max(y, 0), min(y + side_px, height_px)
    left, right = max(x, 0), min(x + side_px, width_px)
    if top < bottom and left < right:
        square[top - y : bottom - y, left - x : right - x] = image[top:bottom, left:right]
    return square


def satellite_u8(rgb: ImageArray, valid: BoolArray) -> NDArray[np.uint8]:
    """Return 8-bit colours of ``rgb`` in 0..1; black only where not valid."""
    levels = np.clip(np.round(rgb * 255.0), 1, 255).astype(np.uint8)
    return np.where(valid[..., None], levels, np.uint8(0))


def thermal_u8(thermal: NDArray[Any]) -> NDArray[np.uint8]:
    """Return 8 bits between robust percentiles, as a camera's automatic gain would."""
    low, high = np.percentile(thermal, _ROBUST_PERCENT)
    scaled = (thermal - low) / max(float(high - low), 1e-6)
    return np.asarray(np.clip(np.round(scaled * 255.0), 0, 255), dtype=np.uint8)


def image_u8(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    """Return pixels that are 8-bit already as they are, and others between robust percentiles."""
    return pixels if pixels.dtype == np.uint8 else thermal_u8(pixels)


def evenly(indices: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return at most ``count`` of the indices, spread over all of them."""
    if count >= len(indices):
        return indices
    return np.asarray(indices[np.linspace(0, len(indices) - 1, count).round().astype(int)])
