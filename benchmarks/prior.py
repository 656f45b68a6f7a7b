"""What the package's estimators are measured against, on the same seam."""

from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.geometry.corners import DegenerateHomographyError, transform_points
from uasthn_cli.types import (
    BoolArray,
    Estimate,
    FloatArray,
    MapFeatures,
    MapWindow,
    Ortho,
)

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # ITU-R BT.601
_STRETCH_PERCENT = (1.0, 99.0)
_RATIO = 0.8
_REPROJECTION_PX = 3.0
_MAGSAC_ITERATIONS = 10_000
_MAGSAC_CONFIDENCE = 0.999
_MIN_INLIERS = 6

Keypoints = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Places ``(n, 2)`` and descriptors ``(n, 128)``."""


class PriorEstimator:
    """Believes the log: what position, attitude and height say, nothing searched."""

    name: ClassVar = "prior"
    stride_px: ClassVar = 1
    halo_px: ClassVar = 0

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return nothing of interest ``(1, h, w)``."""
        return np.zeros((1, *window.valid.shape), np.float32)

    def estimate(
        self, features: MapFeatures, thermal: Ortho, views_px: FloatArray, origin_px: FloatArray
    ) -> Estimate:
        """Return the views where the prior has them."""
        return Estimate((views_px + origin_px)[None], 1.0)


class SiftEstimator:
    """SIFT keypoints (Lowe 2004), ratio test, and a homography by MAGSAC++ (Barath et al. 2020).

    All by OpenCV. A view without a homography answers with the prior, so that views disagree; a
    full frame without one has no answer.
    """

    name: ClassVar = "sift-magsac"
    stride_px: ClassVar = 1
    halo_px: ClassVar = 0

    def __init__(self) -> None:
        """Use OpenCV's defaults: three layers an octave, as many keypoints as there are."""
        self._sift = cv2.SIFT.create()
        self._matcher = cv2.BFMatcher(cv2.NORM_L2)

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return grey values ``(1, h, w)``: keypoints need the whole window, not tiles."""
        return (window.image @ _LUMA)[None]

    def estimate(
        self, features: MapFeatures, thermal: Ortho, views_px: FloatArray, origin_px: FloatArray
    ) -> Estimate:
        """Return each view's corners by its own homography from ortho to window.

        Raises:
            DegenerateHomographyError: the full frame's keypoints find no homography.
        """
        in_window = self._keypoints(features.values[0].astype(np.float32), features.valid)
        in_ortho = self._keypoints(thermal.image, thermal.valid)
        from_px, to_px = self._matches(in_ortho, in_window)
        corners = [self._locate(view, from_px, to_px) for view in views_px]
        if corners[0] is None:
            raise DegenerateHomographyError(f"{len(from_px)} matches give no homography")
        found = [
            view + origin_px if answer is None else answer
            for view, answer in zip(views_px, corners, strict=True)
        ]
        return Estimate(np.stack(found)[None], 1.0)

    def _keypoints(self, image: NDArray[np.float32], valid: BoolArray) -> Keypoints:
        """Return keypoints of the valid part of an image, its contrast stretched to 8 bits."""
        if not valid.any():
            return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)
        low, high = np.percentile(image[valid], _STRETCH_PERCENT)
        grey = np.clip((image - low) / max(float(high - low), 1e-6), 0.0, 1.0) * 255.0
        inner = cv2.erode(valid.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=1)
        points, descriptors = self._sift.detectAndCompute(grey.astype(np.uint8), inner)
        places = np.array([point.pt for point in points], np.float32).reshape(-1, 2)
        if descriptors is None:
            return places, np.zeros((0, 128), np.float32)
        return places, np.asarray(descriptors, np.float32)

    def _matches(self, query: Keypoints, train: Keypoints) -> Keypoints:
        """Return matched places ``(n, 2)`` in both images that pass the ratio test."""
        if len(query[0]) < 2 or len(train[0]) < 2:
            return np.zeros((0, 2), np.float32), np.zeros((0, 2), np.float32)
        pairs = self._matcher.knnMatch(query[1], train[1], k=2)
        good = [first for first, second in pairs if first.distance < _RATIO * second.distance]
        here, there = [match.queryIdx for match in good], [match.trainIdx for match in good]
        return query[0][here], train[0][there]

    def _locate(
        self, view: FloatArray, from_px: NDArray[np.float32], to_px: NDArray[np.float32]
    ) -> FloatArray | None:
        """Return a view's corners in the window by the matches inside it, or None."""
        ring = view[[0, 1, 3, 2]].astype(np.float32)
        inside = [cv2.pointPolygonTest(ring, (float(x), float(y)), False) >= 0 for x, y in from_px]
        if sum(inside) < _MIN_INLIERS:
            return None
        H, inliers = cv2.findHomography(
            from_px[inside],
            to_px[inside],
            cv2.USAC_MAGSAC,
            _REPROJECTION_PX,
            maxIters=_MAGSAC_ITERATIONS,
            confidence=_MAGSAC_CONFIDENCE,
        )
        if H is None or int(np.sum(inliers)) < _MIN_INLIERS:
            return None
        corners = transform_points(np.asarray(H, np.float64), view)
        return corners if np.isfinite(corners).all() else None
