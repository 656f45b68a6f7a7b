"""Where CropTTA cuts its crops out of an image (paper, sec. III-B)."""

import math

import numpy as np

from uasthn_cli.config import Sampling
from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.types import FloatArray


def crop_corners_px(
    size_px: tuple[int, int],
    views: int,
    offset_px: tuple[float, float],
    sampling: Sampling,
    rng: np.random.Generator,
) -> FloatArray:
    """Return corners ``(views, 4, 2)`` of an image and its ``views - 1`` crops, in its pixels.

    ``size_px`` and ``offset_px`` are ``(x, y)``; crops are smaller than the image by the offset
    (``W_CT = W_T - o_c``). ``random`` draws their places from ``rng``; ``grid`` spreads them
    evenly, four being the corners.
    """
    size, offset = np.asarray(size_px, dtype=np.float64), np.asarray(offset_px, dtype=np.float64)
    full = image_corners_px(*size_px)
    crop = image_corners_px(2, 2) * (size - offset - 1.0)
    count = views - 1
    places = _grid(count) if sampling is Sampling.GRID else rng.random((count, 2))
    return np.concatenate([full[None], crop + (places * offset)[:, None]])


def _grid(count: int) -> FloatArray:
    """Return ``count`` places ``(count, 2)`` in the unit square, its corners first."""
    side = max(2, math.ceil(math.sqrt(count)))
    steps = np.linspace(0.0, 1.0, side)
    places = np.array([(x, y) for y in steps for x in steps])
    outward = np.argsort(-np.abs(places - 0.5).sum(axis=1), kind="stable")
    return places[outward][:count]
