"""An estimator of one's own: absolute normalised cross-correlation of gradients."""

import cv2
import numpy as np

from uasthn_cli.matching.spec import EstimatorSpec
from uasthn_cli.seam import Estimate
from uasthn_cli.types import BoolArray, FloatArray, ImageArray, MapFeatures, MapWindow, Ortho


def gradient(image: ImageArray) -> ImageArray:
    """Return how steep a grey image ``(h, w)`` is."""
    along, down = cv2.Sobel(image, cv2.CV_32F, 1, 0), cv2.Sobel(image, cv2.CV_32F, 0, 1)
    return np.hypot(along, down).astype(np.float32)


def inside(valid: BoolArray) -> ImageArray:
    """Return 1 where all neighbours are valid as well: edges of what was seen are no gradients."""
    seen = cv2.erode(valid.astype(np.uint8), np.ones((3, 3)), borderValue=1)
    return seen.astype(np.float32)


class GradientNcc:
    """Tries every shift by whole pixels; see :class:`uasthn_cli.seam.Estimator`."""

    name, stride_px, halo_px = "gradient-ncc", 1, 16

    def encode_map(self, window: MapWindow) -> ImageArray:
        """Return map features ``(1, h, w)``, computed once per tile of the map."""
        return (gradient(window.image.mean(axis=2)) * inside(window.valid))[None]

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return the corners of each view where its part of the frame fits best."""
        image, template = features.values[0].astype(np.float32), gradient(thermal.image)
        corners_px = []
        for view_px in views_px:
            ring = view_px[[0, 1, 3, 2]].round().astype(np.int32)
            mask = cv2.fillConvexPoly(np.zeros_like(template), ring, 1.0) * inside(thermal.valid)
            fit = np.abs(cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED, mask=mask))
            fit[~(fit <= 1.001)] = 0.0  # rounding errors over flat ground
            row, column = np.unravel_index(fit.argmax(), fit.shape)
            corners_px.append(view_px + np.array([column, row]))
        return Estimate(np.stack(corners_px), confidence=1.0)


SPEC = EstimatorSpec(name="gradient-ncc", open=lambda _: GradientNcc(), working_width_px=96)
