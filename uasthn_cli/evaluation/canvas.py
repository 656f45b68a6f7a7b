"""From a pair to what an estimator takes: a map window and a rectified frame at one GSD."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.mapping.radiometry import find_statistics
from uasthn_cli.types import BoolArray, FloatArray, GridBox, MapGrid, MapWindow, Ortho

_MULTIPLE_PX = 16
"""Canvas sides are multiples of it, for networks that halve images several times."""

_BLUR_PER_RATIO = 0.45
"""As where frames are rectified: no detail finer than a pixel of the canvas remains."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A pair on two canvases of one GSD, both about their images' middles.

    ``origin_px`` ``(2,)`` is the window pixel of ortho pixel (0, 0) where both middles coincide;
    ``H_satellite_window`` maps the sample's satellite pixels, ``H_thermal_ortho`` (that is the
    ortho's ``H_frame_ortho``) its thermal pixels.
    """

    window: MapWindow
    thermal: Ortho
    origin_px: FloatArray
    H_satellite_window: FloatArray

    def to_satellite(self, points_px: FloatArray) -> FloatArray:
        """Map window pixels ``(..., 2)`` to the sample's satellite pixels."""
        return transform_points(np.asarray(np.linalg.inv(self.H_satellite_window)), points_px)


def place_pair(sample: MatchSample, width_px: int | None) -> Placed:
    """Put a pair on canvases on which the thermal image is ``width_px`` wide.

    It is never enlarged; None keeps both images as they are.
    """
    thermal_px = sample.thermal.shape[0]
    scale = 1.0 if width_px is None else min(1.0, width_px / thermal_px)
    gsd_m = sample.satellite_gsd_m / scale
    known = np.asarray(sample.satellite.any(axis=2))
    rgb, valid, H_satellite_window = _on_canvas(sample.satellite, known, scale)
    grey, seen, H_thermal_ortho = _on_canvas(
        sample.thermal, np.ones(sample.thermal.shape, np.bool_), scale
    )
    side_px, ortho_px = valid.shape[0], seen.shape[0]
    window = MapWindow(
        image=rgb,
        valid=valid,
        box=GridBox(0, 0, side_px, side_px),
        grid=MapGrid(gsd_m),
        statistics=find_statistics(rgb[valid]),
    )
    middle_px = np.full(2, (ortho_px - 1) / 2)
    ortho = Ortho(grey, seen, gsd_m, H_thermal_ortho, middle_px)
    return Placed(window, ortho, np.full(2, (side_px - ortho_px) / 2), H_satellite_window)


def prior_corners_px(sample: MatchSample) -> FloatArray:
    """Return where the prior has the thermal image's corners ``(4, 2)``: about the middle."""
    thermal_px, satellite_px = sample.thermal.shape[0], sample.satellite.shape[0]
    corners = image_corners_px(thermal_px, thermal_px)
    return np.asarray(corners + (satellite_px - thermal_px) / 2)


def _on_canvas(
    image: NDArray[np.uint8], known: BoolArray, scale: float
) -> tuple[NDArray[np.float32], BoolArray, FloatArray]:
    """Return a square image in 0..1 at another scale, where it is known, and ``H_image_canvas``.

    The canvas is as large as needed; 0 where nothing is known.
    """
    side_px = image.shape[0]
    canvas_px = math.ceil(side_px * scale / _MULTIPLE_PX - 1e-9) * _MULTIPLE_PX
    shift_px = (canvas_px - 1) / 2 - scale * (side_px - 1) / 2
    H = np.array([[scale, 0.0, shift_px], [0.0, scale, shift_px], [0.0, 0.0, 1.0]])
    values = image.astype(np.float32) / np.float32(255.0)
    if scale < 1.0:
        values = np.asarray(cv2.GaussianBlur(values, (0, 0), _BLUR_PER_RATIO / scale), np.float32)
    reach_px = np.abs(np.arange(canvas_px) - (canvas_px - 1) / 2)
    inside = reach_px <= scale * side_px / 2
    valid = (_warped(known.astype(np.float32), H, canvas_px) > 1.0 - 1e-6) & np.outer(
        inside, inside
    )
    warped = _warped(values, H, canvas_px)
    mask = valid[..., None] if image.ndim == 3 else valid
    return np.where(mask, warped, np.float32(0.0)), np.asarray(valid), H


def _warped(image: NDArray[Any], H: FloatArray, canvas_px: int) -> NDArray[np.float32]:
    size_px = (canvas_px, canvas_px)
    warped = cv2.warpAffine(
        image, H[:2], size_px, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(warped, np.float32)
