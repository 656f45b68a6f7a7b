"""Absolute normalised cross-correlation of grey images: no weights, the floor for comparisons."""

from enum import StrEnum
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.matching.search import MIN_OVERLAP, best_shift, view_masks
from uasthn_cli.types import Estimate, FloatArray, ImageArray, MapFeatures, MapWindow, Ortho


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
        """Return one channel ``(1, h, w)``: what is correlated; the map's mean where not valid."""
        grey = window.image @ np.array([0.299, 0.587, 0.114], np.float32)
        filled = np.where(window.valid, grey, np.float32(np.mean(window.statistics.mean)))
        return self._transform(filled.astype(np.float32))[None]

    def estimate(
        self, features: MapFeatures, thermal: Ortho, views_px: FloatArray, origin_px: FloatArray
    ) -> Estimate:
        """Return the best shift of each view inside the window; one iteration, no belief."""
        template = self._transform(_flatten_outside(thermal))
        inner = cv2.erode(thermal.valid.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0)
        masks = view_masks(views_px, inner.astype(bool), 1)
        image = features.values[0].astype(np.float32)
        valid = features.valid.astype(np.float32)
        shifts = []
        for mask in masks:
            scores = cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED, mask=mask)
            scores = np.where(np.isfinite(scores), np.abs(scores), 0.0)
            overlap = cv2.matchTemplate(valid, mask, cv2.TM_CCORR) / max(float(mask.sum()), 1.0)
            shifts.append(best_shift(np.where(overlap >= MIN_OVERLAP, scores, -np.inf)))
        corners = views_px + np.stack(shifts)[:, None]
        return Estimate(corners[None], 1.0)

    def _transform(self, grey: ImageArray) -> ImageArray:
        if self._channel is NccChannel.GREY:
            return grey
        gradient_x, gradient_y = (
            cv2.Sobel(grey, cv2.CV_32F, 1, 0),
            cv2.Sobel(grey, cv2.CV_32F, 0, 1),
        )
        return np.hypot(gradient_x, gradient_y).astype(np.float32)


def _flatten_outside(thermal: Ortho) -> ImageArray:
    """Return the frame with its mean outside the footprint, so that its edge makes no gradient."""
    mean = thermal.image[thermal.valid].mean() if thermal.valid.any() else 0.0
    return np.where(thermal.valid, thermal.image, mean).astype(np.float32)
