"""What both encoders see of an image, by numpy and OpenCV: :mod:`normalise` without torch.

Sides are multiples of 8 pixels.
"""

import cv2
import numpy as np

from uasthn_cli.matching.architecture import (
    LOCAL_WINDOW_PX,
    POOL_PX,
    SATELLITE_EPSILON,
    THERMAL_EPSILON,
)
from uasthn_cli.types import BoolArray, ImageArray, MapStatistics

_LEAST_SHARE = 1e-3


def satellite_input(rgb: ImageArray, valid: BoolArray, statistics: MapStatistics) -> ImageArray:
    """Return the satellite encoder's input ``(6, h, w)`` of colours ``(3, h, w)`` in 0..1."""
    mask = valid.astype(np.float32)
    mean = np.array(statistics.mean, np.float32)[:, None, None]
    large = (rgb - mean) / np.float32(statistics.deviation + 1e-2) * mask
    return np.concatenate([_local_contrast(rgb, mask, SATELLITE_EPSILON), large])


def thermal_input(thermal: ImageArray, valid: BoolArray) -> ImageArray:
    """Return the thermal encoder's input ``(2, h, w)`` of a frame ``(h, w)``."""
    mask = valid.astype(np.float32)
    count = max(float(mask.sum()), 1.0)
    centred = (thermal - np.float32((thermal * mask).sum() / count)) * mask
    deviation = np.sqrt(np.float32((centred * centred).sum() / count))
    large = (centred / (deviation + np.float32(1e-3)))[None]
    return np.concatenate([_local_contrast(large, mask, THERMAL_EPSILON), large])


def _local_contrast(image: ImageArray, mask: ImageArray, epsilon: float) -> ImageArray:
    """Return an image ``(c, h, w)`` minus its local mean, over its local deviation."""
    weights = _smooth(mask)
    weights = np.maximum(weights, np.float32(_LEAST_SHARE))
    mean = np.stack([_smooth(plane * mask) for plane in image]) / weights
    centred = (image - mean) * mask
    variance = _smooth((centred * centred).mean(axis=0) * mask) / weights
    normalised: ImageArray = centred / np.sqrt(np.maximum(variance, 0) + np.float32(epsilon))
    return normalised


def _smooth(plane: ImageArray) -> ImageArray:
    """Return the means of boxes around each pixel, computed on an eightfold reduced image."""
    height, width = plane.shape
    size = (width // POOL_PX, height // POOL_PX)
    reduced = cv2.resize(plane, size, interpolation=cv2.INTER_AREA)
    side = 2 * max(1, LOCAL_WINDOW_PX // POOL_PX // 2) + 1
    blurred = cv2.blur(reduced, (side, side), borderType=cv2.BORDER_CONSTANT)
    smooth = cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(smooth, dtype=np.float32)
