"""From a map of scores over shifts to an answer: the peak, its sub-cell place, and belief in it."""

import math
from collections.abc import Iterator

import cv2
import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.types import BoolArray, FloatArray, ImageArray

MIN_OVERLAP = 0.5
"""Share of a view that must lie on valid map for a shift to count."""

_CONFIDENCE_RADIUS_CELLS = 3.0

_BOX_REACH_CELLS = 5
_BELOW_BEST_NATS = 6.0
_MOST_BOXES = 4

Box = tuple[slice, slice]
"""Rows and columns of shifts."""


def view_masks(views_px: FloatArray, valid: BoolArray, stride_px: int) -> ImageArray:
    """Return ``(N, h, w)`` masks of views ``(N, 4, 2)`` (ortho pixels) on feature cells.

    A cell belongs to a view when its centre lies in the view's quadrilateral (give or take half a
    cell along the edges) and ``valid`` ``(h, w)`` holds there.
    """
    masks = np.zeros((len(views_px), *valid.shape), np.float32)
    bits = 4
    for mask, corners in zip(masks, views_px, strict=True):
        ring = (corners[[0, 1, 3, 2]] - (stride_px - 1) / 2) / stride_px
        cv2.fillConvexPoly(mask, np.round(ring * 2**bits).astype(np.int32), 1.0, shift=bits)
    masks *= valid
    return masks


def best_shift(scores: FloatArray, otherwise: FloatArray | None = None) -> FloatArray:
    """Return the sub-cell peak ``(x, y)`` of ``scores`` ``(rows, columns)``, by two parabolas.

    Where no shift counts (all are -inf), it is ``otherwise``, by default (0, 0).
    """
    if otherwise is not None and not np.isfinite(scores).any():
        return otherwise
    row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
    return np.array(
        [
            column + _parabola(scores[row], int(column)),
            row + _parabola(scores[:, column], int(row)),
        ]
    )


def within_reach(
    shape: tuple[int, int], prior_shift: FloatArray, largest: float = math.inf
) -> BoolArray:
    """Return which of ``(rows, columns)`` shifts lie in the largest disk around the prior's.

    ``prior_shift`` ``(x, y)`` is the shift that the prior implies; the radius is ``largest`` shifts
    at most. A window is snapped outward to
    whole tiles and has corners: without this, wrong answers lie in wait beyond the search radius.
    """
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    last = np.array([shape[1], shape[0]]) - 1.0
    radius = min(float(np.minimum(prior_shift, last - prior_shift).min()), largest)
    near: BoolArray = np.hypot(columns - prior_shift[0], rows - prior_shift[1]) <= radius
    return near


def peak_boxes(scores: FloatArray) -> Iterator[Box]:
    """Yield boxes of shifts, rows and columns, around the places that another view may prefer.

    ``scores`` ``(rows, columns)`` are the whole frame's; the boxes lie around its highest local
    maxima and do not overlap by more than their margins. Views show nearly the same, so none
    prefers a place at which the whole frame fits much worse than at its best.
    """
    finite = np.isfinite(scores)
    if not finite.any():
        return
    field = np.where(finite, scores, scores[finite].min()).astype(np.float32)
    is_peak = (field >= cv2.dilate(field, np.ones((3, 3), np.uint8))) & finite
    is_peak &= scores >= scores.max() - _BELOW_BEST_NATS
    rows, columns = np.nonzero(is_peak)
    order = np.argsort(-scores[rows, columns], kind="stable")
    taken: list[tuple[int, int]] = []
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if all(max(abs(row - r), abs(column - c)) > _BOX_REACH_CELLS for r, c in taken):
            taken.append((row, column))
            yield _around(row, scores.shape[0]), _around(column, scores.shape[1])
            if len(taken) == _MOST_BOXES:
                return


def _around(index: int, length: int) -> slice:
    return slice(max(0, index - _BOX_REACH_CELLS), min(length, index + _BOX_REACH_CELLS + 1))


def posterior_mass(scores: FloatArray, shift: FloatArray, cell_m: float) -> float:
    """Return the soft-max mass of ``scores`` within 25 m (at least three cells) of ``shift``."""
    finite = np.isfinite(scores)
    if not finite.any():
        return 0.0
    weights = np.where(finite, np.exp(scores - scores[finite].max()), 0.0)
    radius = max(TOLERANCE_M / cell_m, _CONFIDENCE_RADIUS_CELLS)
    rows, columns = np.ogrid[: scores.shape[0], : scores.shape[1]]
    near = (columns - shift[0]) ** 2 + (rows - shift[1]) ** 2 <= radius**2
    return float(weights[near].sum() / weights.sum())


def _parabola(values: FloatArray, index: int) -> float:
    """Return the offset of a parabola's vertex from the largest of three neighbouring values."""
    if not 0 < index < len(values) - 1:
        return 0.0
    before, peak, after = (float(v) for v in values[index - 1 : index + 2])
    bend = before - 2 * peak + after
    if not math.isfinite(bend) or bend >= 0:
        return 0.0
    return 0.5 * (before - after) / bend
