"""Frames made worse: faded, badly exposed, bent; each a pure function of pixels and random numbers.

Frames are ``(h, w)`` of any depth. Values of 8-bit frames are taken to span 255 levels, those of
deeper ones what the frame itself spans.
"""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px
from uasthn_cli.synth.flight_config import SensorConfig
from uasthn_cli.synth.kinds import Gain
from uasthn_cli.synth.sensor import KELVIN_PER_COUNT, render_sensor
from uasthn_cli.types import FloatArray, ImageArray

Frame = NDArray[Any]

LARGEST_SHIFT_PX = 64.0
"""How far a corner moves at most along each axis, at the width W_R (paper, sec. V-C)."""

_SATURATED = 0.98
_WORST_NOISE = 0.10
_WORST_STRIPES = 0.05
_INWARDS = np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])


def faded(image: Frame, severity: float, rng: np.random.Generator, camera: SensorConfig) -> Frame:
    """Return what a camera makes of a frame's scene when fog leaves ``(1 - severity)³`` of it.

    Its noise and fixed pattern stay as they are: at severity 1 they are all there is.
    """
    low, high = _levels(image)
    contrast = (1.0 - severity) ** 3 * camera.least_span_k / max(high - low, 1e-6)
    scene_k = (image.astype(np.float32) - np.float32(image.mean())) * np.float32(contrast)
    return retaken(scene_k, image, rng, camera)


def retaken(
    scene_k: ImageArray, image: Frame, rng: np.random.Generator, camera: SensorConfig
) -> Frame:
    """Return a scene of kelvins around 0 as a camera takes it, in ``image``'s depth and mean."""
    if image.dtype == np.uint8:
        return render_sensor(scene_k, rng, camera)
    mean_k = np.float32(image.mean() * KELVIN_PER_COUNT)
    radiometric = replace(camera, gain=Gain.RADIOMETRIC)
    return render_sensor(scene_k + mean_k, rng, radiometric).astype(image.dtype)


def badly_exposed(image: Frame, severity: float, rng: np.random.Generator) -> Frame:
    """Return a frame too bright or too dark, by chance, with noise and stripes, then clipped.

    At severity 1 the brightness is off by so much that 98 % of the scene would be clipped, the
    noise has a tenth and the stripes a twentieth of the whole scale as their deviation.
    """
    low, high = _levels(image)
    span = high - low
    darkest, brightest = np.quantile(image, (1.0 - _SATURATED, _SATURATED))
    offset = (high - darkest) if rng.random() < 0.5 else (low - brightest)
    noise = _WORST_NOISE * rng.standard_normal(image.shape, dtype=np.float32)
    along = (1, image.shape[1]) if rng.random() < 0.5 else (image.shape[0], 1)
    stripes = _WORST_STRIPES * rng.standard_normal(along, dtype=np.float32)
    changed = image + np.float32(severity) * (
        np.float32(offset) + np.float32(span) * (noise + stripes)
    )
    return _in_depth(np.clip(changed, low, high), image)


def shifted_corners_px(
    size_px: tuple[int, int], severity: float, rng: np.random.Generator
) -> FloatArray:
    """Return where ``(4, 2)`` in a frame of ``size_px`` (w, h) the corners of the bent one lie.

    Each moves by up to 64 px of the frame at W_R × W_R, times the severity; inwards, so that no
    pixel has to be made up. The bent frame therefore also looks zoomed, as by a longer lens.
    """
    reach_px = severity * LARGEST_SHIFT_PX / RESIZED_WIDTH_PX * np.array(size_px)
    shifts: FloatArray = _INWARDS * rng.uniform(0.0, 1.0, (4, 2)) * reach_px
    return image_corners_px(*size_px) + shifts


def bent(image: Frame, corners_px: FloatArray) -> Frame:
    """Return a frame of the same size that shows what lies between ``corners_px`` ``(4, 2)``."""
    height_px, width_px = image.shape
    H_bent_frame = homography_from_corners(image_corners_px(width_px, height_px), corners_px)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpPerspective(
            image, H_bent_frame, (width_px, height_px), flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
    )


def blended(image: Frame, other: Frame, share: float) -> Frame:
    """Return a frame of which ``share`` is the other's."""
    mixed = (1.0 - share) * image.astype(np.float32) + share * other.astype(np.float32)
    return _in_depth(mixed, image)


def _levels(image: Frame) -> tuple[float, float]:
    """Return the lowest and highest value that the frame may take."""
    if image.dtype == np.uint8:
        return 0.0, 255.0
    return float(image.min()), float(image.max())


def _in_depth(values: NDArray[np.floating[Any]], image: Frame) -> Frame:
    """Return values in the type of a frame, rounded where that counts whole levels."""
    whole = np.issubdtype(image.dtype, np.integer)
    return (np.rint(values) if whole else values).astype(image.dtype)
