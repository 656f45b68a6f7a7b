"""Fractal noise and cheap wide blurs: the raw material of every landscape."""

import math

import cv2
import numpy as np

from uasthn_cli.types import ImageArray

_SMALL_SIGMA_PX = 4.0
_LARGE = 1_000_000


def fractal_noise(
    rng: np.random.Generator,
    shape: tuple[int, int],
    gsd_m: float,
    wavelength_m: float,
    *,
    roughness: float = 0.5,
    finest_m: float | None = None,
) -> ImageArray:
    """Return noise ``(h, w)`` of zero mean and unit deviation, longest wave ``wavelength_m``.

    Octaves are stacked from coarse to fine, each ``roughness`` times as strong as the one before,
    down to ``finest_m`` (by default a 32nd of the longest wave). Midpoint refinement: every octave
    doubles the grid, so the cost is that of the last octave.
    """
    height, width = shape
    finest_m = max(wavelength_m / 32.0 if finest_m is None else finest_m, gsd_m)
    octaves = math.floor(math.log2(max(wavelength_m / (2.0 * finest_m), 1.0))) + 1
    spacing_px = max(wavelength_m / (2.0 * gsd_m), 1.0)
    rows, columns = math.ceil(height / spacing_px) + 4, math.ceil(width / spacing_px) + 4
    field = rng.standard_normal((rows, columns), dtype=np.float32)
    amplitude = 1.0
    for _ in range(octaves - 1):
        amplitude *= roughness
        doubled = cv2.resize(field, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_CUBIC)
        # The blur takes the grain of the coarser grid out: cubic patches alone look like tiles.
        field = np.asarray(cv2.GaussianBlur(doubled, (3, 3), 0.8), dtype=np.float32)
        field += amplitude * rng.standard_normal(field.shape, dtype=np.float32)
        field = _trimmed(field, height, width, spacing_px / 2 ** (octaves - 1))
    return standardised(_resampled(rng, field, shape, spacing_px / 2 ** (octaves - 1)))


def smooth(field: ImageArray, sigma_px: float) -> ImageArray:
    """Blur ``(h, w)`` or ``(h, w, c)`` by a Gaussian; wide ones on a smaller copy."""
    if sigma_px <= 0.0:
        return field
    if sigma_px <= _SMALL_SIGMA_PX:
        return np.asarray(cv2.GaussianBlur(field, (0, 0), sigma_px), dtype=np.float32)
    height, width = field.shape[:2]
    factor = sigma_px / 2.0
    small = (max(2, math.ceil(width / factor)), max(2, math.ceil(height / factor)))
    shrunk = cv2.GaussianBlur(cv2.resize(field, small, interpolation=cv2.INTER_AREA), (0, 0), 2.0)
    return np.asarray(
        cv2.resize(shrunk, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.float32
    )


def standardised(field: ImageArray) -> ImageArray:
    """Return a field with zero mean and unit deviation."""
    sample = field[::3, ::3] if field.size > _LARGE else field
    mean, deviation = cv2.meanStdDev(sample)
    scale = np.float32(1.0 / (float(deviation.ravel()[0]) + 1e-9))
    return (field - np.float32(mean.ravel()[0])) * scale


def _trimmed(field: ImageArray, height: int, width: int, spacing_px: float) -> ImageArray:
    """Cut rows and columns that lie outside the image at the final spacing, a margin kept."""
    rows, columns = math.ceil(height / spacing_px) + 8, math.ceil(width / spacing_px) + 8
    return field[:rows, :columns]


def _resampled(
    rng: np.random.Generator, field: ImageArray, shape: tuple[int, int], spacing_px: float
) -> ImageArray:
    """Read the noise grid at the image's pixels, from a random place within its margin."""
    scale = 1.0 / spacing_px
    interpolation = cv2.INTER_CUBIC if spacing_px > 2.0 else cv2.INTER_LINEAR
    offset = rng.uniform(1.0, 2.5, 2)
    matrix = np.array([[scale, 0.0, offset[0]], [0.0, scale, offset[1]]])
    return np.asarray(
        cv2.warpAffine(
            field,
            matrix,
            (shape[1], shape[0]),
            flags=interpolation | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT_101,
        ),
        dtype=np.float32,
    )
