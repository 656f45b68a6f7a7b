"""Boxes of the second stage in training: perturbed, and where the truth lies in them."""

from typing import Final

from torch import Tensor

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.matching.displacement.homography import corners_at_width, square_corners
from uasthn_cli.matching.displacement.sthn import bounding_boxes

_SIDES: Final = (1 / 24, 2.0)
"""Sides of boxes, as shares of the satellite image: an untrained first stage knows no bounds."""


def perturbed_boxes(displacement: Tensor, noise: Tensor, width_px: int, reach_px: float) -> Tensor:
    """Return square boxes ``(B, 4, 2)`` around displaced corners, their edges moved.

    ``noise`` ``(B, 4)`` in -1..1 moves left, top, right and bottom edges by up to ``reach_px``
    pixels of the full satellite image, ``width_px`` wide; the longer side then makes the square
    (paper, sec. IV: bounding box augmentation).
    """
    boxes_px = bounding_boxes(displacement, width_px, 0.0)
    first = boxes_px[:, 0] + reach_px * noise[:, :2]
    last = boxes_px[:, 3] + reach_px * noise[:, 2:]
    shortest, longest = (share * width_px for share in _SIDES)
    side = (last - first).amax(dim=1, keepdim=True).clamp(shortest, longest)
    middle = 0.5 * (first + last)
    signs = 2.0 * square_corners(2, displacement) - 1.0
    return middle[:, None] + 0.5 * signs * side[:, None]


def displacement_in_boxes(boxes_px: Tensor, displacement: Tensor, width_px: int) -> Tensor:
    """Return what a second stage should say, in pixels of the resized boxes ``(B, 4, 2)``.

    The inverse of :func:`uasthn_cli.matching.displacement.sthn.displacement_of_boxes`.
    """
    sides_px = boxes_px[:, 3, 0] - boxes_px[:, 0, 0] + 1.0
    corners_px = corners_at_width(displacement, width_px)
    return (corners_px - boxes_px) * (RESIZED_WIDTH_PX / sides_px)[:, None, None]
