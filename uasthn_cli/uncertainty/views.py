"""CropTTA views: the full frame and crops of it (paper, sec. III-B)."""

import math
import os
import zlib

import numpy as np

from uasthn_cli.config import CropTtaConfig, Sampling
from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.types import FloatArray


def crop_views_px(
    width_px: int, height_px: int, config: CropTtaConfig, frame_name: str
) -> FloatArray:
    """Return corners ``(N_C, 4, 2)`` of the full frame and its ``N_C - 1`` crops, frame pixels.

    Crops have ``1 - offset_fraction`` of the frame's width and height (``W_CT = W_T - o_c``).
    ``random`` draws their places from the seed and the frame's name, so that a frame's views do not
    depend on which frames came before it; ``grid`` spreads them evenly, four being the corners.
    """
    size_px = np.array([width_px, height_px], dtype=np.float64)
    offset_px = config.offset_fraction * size_px
    full = image_corners_px(width_px, height_px)
    crop = image_corners_px(2, 2) * (size_px - offset_px - 1)
    count = config.views - 1
    if config.sampling is Sampling.GRID:
        places = _grid(count)
    else:
        rng = np.random.default_rng([config.seed, zlib.crc32(os.fsencode(frame_name))])
        places = rng.random((count, 2))
    return np.concatenate([full[None], crop + (places * offset_px)[:, None]])


def _grid(count: int) -> FloatArray:
    """Return ``count`` places ``(count, 2)`` in the unit square, its corners first."""
    side = max(2, math.ceil(math.sqrt(count)))
    steps = np.linspace(0.0, 1.0, side)
    places = np.array([(x, y) for y in steps for x in steps])
    outward = np.argsort(-np.abs(places - 0.5).sum(axis=1), kind="stable")
    return places[outward][:count]
