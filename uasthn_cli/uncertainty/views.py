"""CropTTA views: the full frame and crops of it (paper, sec. III-B)."""

import os
import zlib

import numpy as np

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.geometry.crops import crop_corners_px
from uasthn_cli.types import FloatArray


def crop_views_px(
    width_px: int, height_px: int, config: CropTtaConfig, frame_name: str
) -> FloatArray:
    """Return corners ``(N_C, 4, 2)`` of the full frame and its ``N_C - 1`` crops, frame pixels.

    Crops have ``1 - offset_fraction`` of the frame's width and height. ``random`` draws their
    places from the seed and the frame's name, so that a frame's views do not depend on which frames
    came before it.
    """
    offset_px = (config.offset_fraction * width_px, config.offset_fraction * height_px)
    rng = np.random.default_rng([config.seed, zlib.crc32(os.fsencode(frame_name))])
    return crop_corners_px((width_px, height_px), config.views, offset_px, config.sampling, rng)
