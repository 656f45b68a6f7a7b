"""Random fields and small image operations that the data engine is made of."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.types import ImageArray


def standardise(image: NDArray[Any]) -> ImageArray:
    """Return ``image`` with zero mean and unit deviation."""
    mean, deviation = cv2.meanStdDev(image)
    standardised = (image - mean[0, 0]) / (deviation[0, 0] + 1e-6)
    return np.asarray(standardised, dtype=np.float32)


def blur(image: NDArray[Any], sigma_px: float) -> ImageArray:
    """Return a Gaussian blur of standard deviation ``sigma_px``."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32)


def fractal_noise(
    rng: np.random.Generator, size_px: int, scale_px: float, octaves: int
) -> ImageArray:
    """Return smooth noise ``(size, size)``: octaves from ``scale_px`` down, halving amplitude."""
    total = np.zeros((size_px, size_px), np.float32)
    for octave in range(octaves):
        cells = min(size_px, max(2, int(size_px / scale_px * 2**octave)))
        grid = rng.standard_normal((cells, cells), dtype=np.float32)
        resized = cv2.resize(grid, (size_px, size_px), interpolation=cv2.INTER_CUBIC)
        total += np.float32(0.5**octave) * resized
    return total


def directional_derivative(image: ImageArray, azimuth_rad: float) -> ImageArray:
    """Return the slope of ``image`` towards an azimuth: shading under a low sun."""
    gradient_y, gradient_x = np.gradient(image)
    slope = gradient_x * np.cos(azimuth_rad) + gradient_y * np.sin(azimuth_rad)
    return np.asarray(slope, dtype=np.float32)


def riesz_transform(image: ImageArray, azimuth_rad: float) -> ImageArray:
    """Return the Riesz transform along an azimuth: a derivative that keeps every scale's energy.

    If an image is shading of a relief, its Riesz transform looks like the relief's height or like
    its shading from another side, which is what a night-thermal camera sees of sand.
    """
    fy = np.fft.fftfreq(image.shape[0]).astype(np.float32)[:, None]
    fx = np.fft.rfftfreq(image.shape[1]).astype(np.float32)[None]
    frequency = np.hypot(fx, fy)
    frequency[0, 0] = 1.0
    kernel = 1j * (fx * np.cos(azimuth_rad) + fy * np.sin(azimuth_rad)) / frequency
    response = np.fft.irfft2(np.fft.rfft2(image) * kernel, s=image.shape)
    return np.asarray(response, dtype=np.float32)


def resize_square(image: NDArray[Any], size_px: int) -> ImageArray:
    """Return ``image`` at ``(size, size)``: by area when it shrinks, bilinear when it grows."""
    method = cv2.INTER_AREA if image.shape[0] > size_px else cv2.INTER_LINEAR
    resized = cv2.resize(image, (size_px, size_px), interpolation=method)
    return np.asarray(resized, dtype=np.float32)
