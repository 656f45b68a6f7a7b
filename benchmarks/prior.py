"""What the package's estimators are measured against, on the same seam: the log itself."""

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.seam import Estimate
from uasthn_cli.types import FloatArray, MapFeatures, MapWindow, Ortho


class PriorEstimator:
    """Believes the log: what position, attitude and height say, nothing searched."""

    name: ClassVar = "prior"
    stride_px: ClassVar = 1
    halo_px: ClassVar = 0

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return nothing of interest ``(1, h, w)``."""
        return np.zeros((1, *window.valid.shape), np.float32)

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return the views where the prior has them."""
        return Estimate(views_px + origin_px, 1.0)
