"""Map windows and thermal cut-outs of them, whose true shift is known."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.seam import Estimator
from uasthn_cli.types import (
    BoolArray,
    FloatArray,
    GridBox,
    ImageArray,
    MapFeatures,
    MapGrid,
    MapStatistics,
    MapWindow,
    Ortho,
)

GSD_M = 2.0


def map_window(grey: NDArray[Any], valid: BoolArray | None = None) -> MapWindow:
    """Return a grey picture ``(h, w)`` of 0..255 as a window of a colour map."""
    height_px, width_px = grey.shape
    valid = np.ones(grey.shape, np.bool_) if valid is None else valid
    image = np.repeat((grey / 255.0)[..., None], 3, axis=-1) * valid[..., None]
    inside = image[valid]
    mean = float(inside.mean())
    return MapWindow(
        image=image.astype(np.float32),
        valid=valid,
        box=GridBox(0, 0, width_px, height_px),
        grid=MapGrid(GSD_M),
        statistics=MapStatistics((mean, mean, mean), float(inside.std())),
    )


def encoded(estimator: Estimator, window: MapWindow) -> MapFeatures:
    """Return an estimator's features of a window, half precision as the tiles keep them."""
    stride = estimator.stride_px
    rows, columns = (side // stride for side in window.valid.shape)
    valid: BoolArray = np.logical_and.reduce(
        window.valid.reshape(rows, stride, columns, stride), axis=(1, 3)
    )
    values = estimator.encode_map(window).astype(np.float16)
    return MapFeatures(values, valid, window.box, window.grid, stride)


def thermal_cut(
    grey: NDArray[Any], corner_px: tuple[int, int], size_px: tuple[int, int], inset_px: int = 0
) -> Ortho:
    """Return the piece of a picture that starts at ``corner_px`` (x, y), ``size_px`` (w, h) large.

    ``inset_px`` pixels along its left and upper edge are not valid.
    """
    x, y = corner_px
    image: ImageArray = (grey[y : y + size_px[1], x : x + size_px[0]] / 255.0).astype(np.float32)
    valid = np.zeros(image.shape, np.bool_)
    valid[inset_px:, inset_px:] = True
    H = np.eye(3)
    return Ortho(np.where(valid, image, 0.0).astype(np.float32), valid, GSD_M, H, np.zeros(2))


def full_view(thermal: Ortho) -> FloatArray:
    """Return one view ``(1, 4, 2)``: all of the ortho."""
    height_px, width_px = thermal.image.shape
    return image_corners_px(width_px, height_px)[None]


def centred_origin(window: MapWindow, thermal: Ortho) -> FloatArray:
    """Return the window pixel of ortho pixel (0, 0) for a prior in the middle of the window."""
    room = np.array(window.valid.shape[::-1]) - np.array(thermal.valid.shape[::-1])
    middle: FloatArray = room / 2.0
    return middle
