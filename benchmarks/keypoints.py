"""Keypoints of OpenCV with a homography by MAGSAC++: what photogrammetry would try first.

Parameters were chosen on flights that ``uasthn synth`` renders (other seeds than any benchmark's).
"""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.matching.keypoint_matches import Matches, estimate_from_matches
from uasthn_cli.seam import Estimate
from uasthn_cli.types import BoolArray, FloatArray, ImageArray, MapFeatures, MapWindow, Ortho

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # ITU-R BT.601
_STRETCH_PERCENT = (1.0, 99.0)
_ENLARGEMENT = 2
_RATIO = 0.95
_AKAZE_THRESHOLD = 1e-4
_MARGIN_PX = 5

Keypoints = tuple[FloatArray, NDArray[Any]]
"""Places ``(n, 2)`` and descriptors ``(n, length)``."""


class KeypointEstimator:
    """Upright keypoints in twofold enlargements, ratio test (Lowe 2004), MAGSAC++ for each view.

    Ortho and map are both north-up, so keypoints need no turn. The frame is matched as it is and
    inverted: night turns contrast round as it likes. A full frame without a homography has no
    answer. So lax a ratio test leaves few right matches among many: their share says nothing, so
    that, as with correlation, an answer is judged by its crops alone.
    """

    stride_px = 1
    halo_px = 0

    def __init__(self, name: str, detector: Any, norm: int) -> None:
        """Use a ``cv2.Feature2D`` whose descriptors are compared by one of OpenCV's norms."""
        self.name, self._detector = name, detector
        self._matcher = cv2.BFMatcher(norm)

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return grey values ``(1, h, w)``: keypoints need the whole window, not tiles."""
        return (window.image @ _LUMA)[None]

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return each view's corners by its own homography from ortho to window.

        Raises:
            DegenerateHomographyError: the full frame's keypoints find no homography.
        """
        in_window = self._keypoints(features.values[0].astype(np.float32), features.valid)
        found = [
            self._matches(self._keypoints(image, thermal.valid), in_window)
            for image in (thermal.image, -thermal.image)
        ]
        from_px, to_px = (np.concatenate(places) for places in zip(*found, strict=True))
        matches = from_px, to_px
        estimate = estimate_from_matches(features, thermal, views_px, origin_px, matches)
        return replace(estimate, confidence=1.0)

    def _keypoints(self, image: ImageArray, valid: BoolArray) -> Keypoints:
        """Return keypoints of the valid part of an image, its contrast stretched to 8 bits."""
        if not valid.any():
            return _NOTHING
        low, high = np.percentile(image[valid], _STRETCH_PERCENT)
        grey = np.clip((image - low) / max(float(high - low), 1e-6), 0.0, 1.0) * 255.0
        square = np.ones((_MARGIN_PX, _MARGIN_PX), np.uint8)
        inner = cv2.erode(valid.astype(np.uint8), square, borderValue=1)
        large, mask = (
            cv2.resize(array, None, fx=_ENLARGEMENT, fy=_ENLARGEMENT, interpolation=kind)
            for array, kind in (
                (grey.astype(np.uint8), cv2.INTER_CUBIC),
                (inner, cv2.INTER_NEAREST),
            )
        )
        points = _upright(self._detector.detect(large, mask))
        points, descriptors = self._detector.compute(large, points)
        if descriptors is None:
            return _NOTHING
        places = np.array([point.pt for point in points], np.float64)
        return (places + 0.5) / _ENLARGEMENT - 0.5, descriptors

    def _matches(self, query: Keypoints, train: Keypoints) -> Matches:
        """Return matched places ``(n, 2)`` in both images that pass the ratio test."""
        if len(query[0]) < 2 or len(train[0]) < 2:
            return _NOTHING[0], _NOTHING[0]
        pairs = self._matcher.knnMatch(query[1], train[1], k=2)
        good = [first for first, second in pairs if first.distance < _RATIO * second.distance]
        here, there = [match.queryIdx for match in good], [match.trainIdx for match in good]
        return query[0][here], train[0][there]


_NOTHING: Keypoints = (np.zeros((0, 2)), np.zeros((0, 0), np.float32))


def sift_magsac() -> KeypointEstimator:
    """Return SIFT (Lowe 2004) with OpenCV's own settings."""
    return KeypointEstimator("sift-magsac", cv2.SIFT.create(), cv2.NORM_L2)


def akaze_magsac() -> KeypointEstimator:
    """Return AKAZE (Alcantarilla et al. 2013), which must be there: see :func:`has_akaze`."""
    home = _akaze_home()
    detector = home.AKAZE.create(
        descriptor_type=home.AKAZE_DESCRIPTOR_MLDB_UPRIGHT, threshold=_AKAZE_THRESHOLD
    )
    return KeypointEstimator("akaze-magsac", detector, cv2.NORM_HAMMING)


def has_akaze() -> bool:
    """Tell whether OpenCV has AKAZE: up to version 4 all builds have, later the contrib ones."""
    return _akaze_home() is not None


def _akaze_home() -> Any:
    return cv2 if hasattr(cv2, "AKAZE_create") else getattr(cv2, "xfeatures2d", None)


def _upright(points: Any) -> list[Any]:
    """Return keypoints without their angles, each place and size once."""
    kept = {(point.pt, point.size): point for point in points}
    for point in kept.values():
        point.angle = 0.0
    return list(kept.values())
