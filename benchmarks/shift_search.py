"""Search over all shifts that the rivals share: grey map, best allowed shift of every view."""

from abc import ABC, abstractmethod
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from uasthn_cli.matching.search import MIN_OVERLAP, best_shift, view_masks, within_reach
from uasthn_cli.seam import Estimate
from uasthn_cli.types import FloatArray, ImageArray, MapFeatures, MapWindow, Ortho

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # ITU-R BT.601


class ShiftSearch(ABC):
    """An estimator that scores every shift of every view; it has no belief in its answer."""

    name: str
    stride_px = 1
    halo_px = 0

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return grey values ``(1, h, w)``."""
        return (window.image @ _LUMA)[None]

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return the best shift of each view within the search radius."""
        masks = view_masks(views_px, thermal.valid, 1)
        valid = features.valid.astype(np.float32)
        shifts = []
        for mask, scores in zip(masks, self.scores(features, thermal, masks), strict=True):
            overlap = cv2.matchTemplate(valid, mask, cv2.TM_CCORR) / max(float(mask.sum()), 1.0)
            allowed = (overlap >= MIN_OVERLAP) & within_reach(overlap.shape, origin_px)
            shifts.append(best_shift(np.where(allowed, scores, -np.inf), otherwise=origin_px))
        return Estimate(views_px + np.stack(shifts)[:, None], 1.0)

    @abstractmethod
    def scores(self, features: MapFeatures, thermal: Ortho, masks: ImageArray) -> list[FloatArray]:
        """Return a map of scores per mask ``(N, h, w)``: every shift inside the window."""


def fft_size(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return the smallest size of transform that holds an image and has small prime factors."""
    height, width = (next_fast_len(side, real=True) for side in shape)
    return height, width


def inside_window(response: FloatArray, features: MapFeatures, thermal: Ortho) -> FloatArray:
    """Return a circular correlation ``(..., H, W)`` at the shifts that stay in the window."""
    rows, columns = (
        n - m + 1 for n, m in zip(features.valid.shape, thermal.valid.shape, strict=True)
    )
    return response[..., :rows, :columns]
