"""Phase correlation: only the phases of the cross spectrum count, not its magnitudes."""

import cv2
import numpy as np
from scipy.fft import fftfreq, irfft2, rfft2, rfftfreq
from shift_search import ShiftSearch, fft_size, inside_window

from uasthn_cli.types import FloatArray, ImageArray, MapFeatures, Ortho

_WHITENING = 0.9
"""Power of the magnitude that is divided out; 1 is Kuglin & Hines' own."""

_BLUR_PX = 0.7
"""Deviation of a Gaussian over the response: the highest frequencies are noise."""

_TAPER = 0.25
"""Share of a view's half width over which it fades in."""


class PhaseCorrelationEstimator(ShiftSearch):
    """Kuglin & Hines (1975) for a small masked view in a large window, its sign ignored.

    Views fade in from their edges as under a Hann window. Parameters were chosen on flights that
    ``uasthn synth`` renders.
    """

    name = "phase-correlation"

    def scores(self, features: MapFeatures, thermal: Ortho, masks: ImageArray) -> list[FloatArray]:
        """Return the magnitude of the response at every shift."""
        size = fft_size(features.valid.shape)
        low_pass = _low_pass(size)
        grey = _weighted(features.values[0], features.valid.astype(np.float32))
        in_window = rfft2(grey, s=size)
        found = []
        for mask in masks:
            cross = in_window * np.conj(rfft2(_weighted(thermal.image, _faded(mask)), s=size))
            magnitude = np.abs(cross)
            floor = 1e-9 * max(float(magnitude.max()), 1e-9)
            response = irfft2(cross / (magnitude + floor) ** _WHITENING * low_pass, s=size)
            found.append(np.abs(inside_window(response, features, thermal)))
        return found


def _weighted(image: FloatArray | ImageArray, weights: ImageArray) -> ImageArray:
    """Return an image less its weighted mean, times its weights."""
    mean = (image * weights).sum() / max(float(weights.sum()), 1e-6)
    weighted: ImageArray = ((image - mean) * weights).astype(np.float32)
    return weighted


def _faded(mask: ImageArray) -> ImageArray:
    """Return a mask that rises from 0 at its edge to 1 like half a Hann window."""
    padded = np.pad(mask.astype(np.uint8), 1)
    depth_px = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
    width_px = max(_TAPER * float(depth_px.max()), 1.0)
    faded: ImageArray = 0.5 - 0.5 * np.cos(np.pi * np.minimum(depth_px / width_px, 1.0))
    return faded


def _low_pass(size: tuple[int, int]) -> FloatArray:
    """Return the spectrum of a Gaussian of ``_BLUR_PX``."""
    squared = fftfreq(size[0])[:, None] ** 2 + rfftfreq(size[1]) ** 2
    spectrum: FloatArray = np.exp(-2.0 * (np.pi * _BLUR_PX) ** 2 * squared)
    return spectrum
