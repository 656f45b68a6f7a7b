"""Absolute normalised cross-correlation of grey images: no weights, the floor for comparisons."""

from enum import StrEnum
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.matching.search import (
    MIN_OVERLAP,
    best_shift,
    posterior_mass,
    view_masks,
    within_reach,
)
from uasthn_cli.seam import Estimate
from uasthn_cli.types import BoolArray, FloatArray, ImageArray, MapFeatures, MapWindow, Ortho

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # ITU-R BT.601

CELLS_PER_SAMPLE = 90.0
"""How many feature cells (of 2 × 2 pixels) count as one independent sample.

Neighbouring cells repeat one another.
"""

LARGEST_CORRELATION = 0.95
"""Beyond it a likelihood says nothing more."""

_PIXELS_PER_CELL = 4

_HIGHEST_SCORE = 1.001
"""Over flat ground OpenCV divides rounding errors by one another."""


class NccChannel(StrEnum):
    """What is correlated: brightness, or the magnitude of its gradient."""

    GREY = "grey"
    GRADIENT = "gradient"


class NccEstimator:
    """Masked NCC by OpenCV, its sign ignored (night inverts contrast as it likes)."""

    stride_px = 1
    halo_px = 16

    def __init__(self, channel: NccChannel = NccChannel.GREY) -> None:
        """Correlate brightness or gradient magnitude."""
        self._channel = channel
        self.name = "ncc" if channel is NccChannel.GREY else f"ncc-{channel}"

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return one channel ``(1, h, w)``: what is correlated; 0 where not valid."""
        return channel_image(luma(window.image), window.valid, self._channel)[None]

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return the best shift of each view inside the window."""
        template = channel_image(thermal.image, thermal.valid, self._channel)
        masks = view_masks(views_px, _trusted(thermal.valid, self._channel), 1)
        image = _centred(features.values[0].astype(np.float32), features.valid)
        valid = features.valid.astype(np.float32)
        shifts, likelihoods = [], []
        for mask in masks:
            samples = float(mask.sum()) / (_PIXELS_PER_CELL * CELLS_PER_SAMPLE)
            scores = np.abs(cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED, mask=mask))
            scores = np.where(scores <= _HIGHEST_SCORE, scores, 0.0)
            overlap = cv2.matchTemplate(valid, mask, cv2.TM_CCORR) / max(float(mask.sum()), 1.0)
            allowed = (overlap >= MIN_OVERLAP) & within_reach(scores.shape, origin_px)
            scores = np.where(allowed, scores.astype(np.float64), -np.inf)
            believed = np.where(allowed, log_likelihood(scores, samples), -np.inf)
            if evidence is not None:
                scores = believed = believed + evidence
            shifts.append(best_shift(scores, otherwise=origin_px))
            likelihoods.append(believed)
        corners = views_px + np.stack(shifts)[:, None]
        confidence = posterior_mass(likelihoods[0], shifts[0], thermal.gsd_m)
        return Estimate(corners, confidence, likelihoods[0])


def log_likelihood(correlation: FloatArray, samples: float) -> FloatArray:
    """Return the log-likelihood of correlations between ``samples`` normal pairs.

    ``(1 - r²) ** (-n / 2)``, whatever the sign; -inf (an excluded shift) counts as 0.
    """
    finite = np.where(np.isfinite(correlation), correlation, 0.0)
    squared = np.clip(finite, -LARGEST_CORRELATION, LARGEST_CORRELATION) ** 2
    return np.asarray(-0.5 * samples * np.log1p(-squared))


def luma(rgb: ImageArray) -> ImageArray:
    """Return the brightness ``(h, w)`` of a colour image ``(h, w, 3)``."""
    return np.asarray(rgb @ _LUMA, dtype=np.float32)


def channel_image(grey: ImageArray, valid: BoolArray, channel: NccChannel) -> ImageArray:
    """Return what is correlated ``(h, w)``, 0 where it cannot be trusted."""
    if channel is NccChannel.GRADIENT:
        grey = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    return np.where(_trusted(valid, channel), grey, 0.0).astype(np.float32)


def _trusted(valid: BoolArray, channel: NccChannel) -> BoolArray:
    """Return the valid pixels; for gradients, those whose neighbours are valid as well."""
    if channel is NccChannel.GREY:
        return valid
    square = np.ones((3, 3), np.uint8)
    return cv2.erode(valid.astype(np.uint8), square, borderValue=1).astype(bool)


def _centred(image: ImageArray, valid: BoolArray) -> ImageArray:
    """Return an image less its mean, 0 where not valid.

    Correlation does not see a constant, but it would see a border as black as what lies beyond.
    """
    mean = image[valid].mean() if valid.any() else np.float32(0.0)
    return np.where(valid, image - mean, np.float32(0.0)).astype(np.float32)
