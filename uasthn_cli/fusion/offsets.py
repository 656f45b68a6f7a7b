"""A frame's scores as a likelihood over the error of its prior's position, and what that says."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.config import MAP_PIXEL_ERROR, TOLERANCE_M
from uasthn_cli.types import LEAST_LOG, LOG_OF_LEVEL, FloatArray, ImageArray, OffsetLikelihood

_PEAK_STEPS = 3

AnyFloats = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True)
class OffsetGrid:
    """Offsets that are told apart: ``2 * half + 1`` each way, ``cell_m`` apart.

    Beyond ``radius_m`` of the middle no frame can lie; None: anywhere on the grid.
    """

    half: int
    cell_m: float
    radius_m: float | None = None

    @property
    def size(self) -> int:
        """Cells along one side."""
        return 2 * self.half + 1


@dataclass(frozen=True, slots=True)
class Placement2d:
    """How entry ``(j, i)`` of a score map lies on the ground.

    It moves the prior by ``(i, j) * pitch_m - prior_m`` metres to the right (east) and down
    (south); ``prior_m`` ``(2,)`` is thus the entry at which the prior itself is right.
    """

    pitch_m: float
    prior_m: FloatArray


@dataclass(frozen=True, slots=True)
class PosteriorSummary:
    """A posterior in a few numbers; see :class:`uasthn_cli.types.Trust`."""

    confidence: float
    entropy_nats: float
    sigma_m: float
    covariance_m2: FloatArray


def grid_of_radius(radius_m: float, pitch_m: float, largest_half: int = 100) -> OffsetGrid:
    """Return the grid that holds a search radius, as fine as the scores or as memory allows."""
    cell_m = max(pitch_m, radius_m / largest_half)
    return OffsetGrid(math.ceil(radius_m / cell_m), cell_m, radius_m)


def offset_likelihood(
    scores: FloatArray, placement: Placement2d, grid: OffsetGrid, centre_m: FloatArray
) -> OffsetLikelihood:
    """Return scores ``(rows, columns)``, -inf where nothing was seen, on a grid of offsets.

    ``centre_m`` ``(2,)`` (east, north) is the offset from the log's position of the prior that the
    scores are relative to. A grid coarser than the scores keeps the best of each cell; a finer one
    interpolates. Where the map shows nothing the frame says nothing: as likely as the mean of what
    was seen.
    """
    if not np.isfinite(scores).any():
        return flat_likelihood(grid, centre_m)
    field, unseen = _levelled(scores)
    ratio = grid.cell_m / placement.pitch_m
    if ratio > 1.0:
        side = 2 * math.ceil(ratio / 2) + 1
        field = cv2.dilate(field, np.ones((side, side), np.uint8)).astype(np.float32)
    onto = Placement2d(grid.cell_m, np.full(2, grid.half * grid.cell_m))
    sampled = _sampled(field, unseen, placement, onto, (grid.size, grid.size))
    if grid.radius_m is not None:
        east, north = cell_offsets_m(grid.size, grid.cell_m, np.zeros(2))
        sampled = np.where(np.hypot(east, north) <= grid.radius_m, sampled, -np.inf)
    return OffsetLikelihood.of(sampled - sampled.max(), grid.cell_m, centre_m)


def flat_likelihood(grid: OffsetGrid, centre_m: FloatArray) -> OffsetLikelihood:
    """Return the likelihood of a frame that says nothing."""
    return OffsetLikelihood(np.zeros((grid.size, grid.size), np.uint8), grid.cell_m, centre_m)


def scores_elsewhere(
    scores: FloatArray, placement: Placement2d, onto: Placement2d, shape: tuple[int, int]
) -> FloatArray:
    """Return scores ``(rows, columns)`` on another lattice of ``shape``, none of them -inf.

    Where nothing was seen the frame says nothing, as in :func:`offset_likelihood`.
    """
    if not np.isfinite(scores).any():
        return np.zeros(shape)
    field, unseen = _levelled(scores)
    return _sampled(field, unseen, placement, onto, shape).astype(np.float64)


def _levelled(scores: FloatArray) -> tuple[ImageArray, float]:
    """Return scores whose best is 0, and what stands where nothing was seen."""
    finite = np.isfinite(scores)
    best = float(scores[finite].max())
    unseen = max(math.log(float(np.exp(scores[finite] - best).mean())), LEAST_LOG)
    field = np.where(finite, np.maximum(scores - best, LEAST_LOG), unseen)
    return field.astype(np.float32), unseen


def _sampled(
    field: ImageArray,
    unseen: float,
    placement: Placement2d,
    onto: Placement2d,
    shape: tuple[int, int],
) -> ImageArray:
    """Return a field of one lattice on another, ``unseen`` beyond its border."""
    ratio = onto.pitch_m / placement.pitch_m
    start = (placement.prior_m - onto.prior_m) / placement.pitch_m
    sampled = cv2.warpAffine(
        field,
        np.array([[ratio, 0.0, start[0]], [0.0, ratio, start[1]]]),
        (shape[1], shape[0]),
        flags=(cv2.INTER_CUBIC if ratio < 1.0 else cv2.INTER_LINEAR) | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=unseen,
    )
    return np.asarray(sampled, dtype=np.float32)


def posterior_of(likelihood: OffsetLikelihood) -> FloatArray:
    """Return the posterior ``(n, n)`` of a frame alone, every offset being as likely before."""
    weights = np.exp(LOG_OF_LEVEL.astype(np.float64))[likelihood.levels]
    return np.asarray(weights / weights.sum())


def cell_offsets_m(size: int, cell_m: float, centre_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return east ``(1, n)`` and north ``(n, 1)`` metres of the cells of an offset grid."""
    steps = (np.arange(size) - size // 2) * cell_m
    return centre_m[0] + steps[None, :], centre_m[1] - steps[:, None]


def best_offset_m(posterior: AnyFloats, cell_m: float, centre_m: FloatArray) -> FloatArray:
    """Return the mean ``(east, north)`` of the posterior ``(n, n)`` around its highest cell."""
    row, column = np.unravel_index(int(posterior.argmax()), posterior.shape)
    east, north = cell_offsets_m(len(posterior), cell_m, centre_m)
    reach_m = max(3.0 * cell_m, 0.5 * TOLERANCE_M)
    peak = np.array([east[0, column], north[row, 0]])
    # the mean lies within reach of the place before: thrice, and the rest is never asked
    posterior, east, north = _near(posterior, east, north, peak, _PEAK_STEPS * reach_m)
    for _ in range(_PEAK_STEPS):  # the mean shifts the neighbourhood it is taken over
        near = (east - peak[0]) ** 2 + (north - peak[1]) ** 2 <= reach_m**2
        weights = posterior * near
        total = weights.sum()
        peak = np.array([(weights * east).sum() / total, (weights * north).sum() / total])
    return peak


def summarise_posterior(
    posterior: AnyFloats, cell_m: float, centre_m: FloatArray, answer_m: FloatArray
) -> PosteriorSummary:
    """Return what a posterior ``(n, n)`` says of the error of ``answer_m`` ``(2,)``.

    The covariance is taken about the answer, within the tolerance (a frame on the wrong hill is a
    matter of confidence, not of spread), and holds at least the variance of a cell.
    """
    east, north = cell_offsets_m(len(posterior), cell_m, centre_m)
    by_column = posterior.sum(axis=0, dtype=np.float64)
    by_row = posterior.sum(axis=1, dtype=np.float64)
    distance2 = by_column @ (east[0] - answer_m[0]) ** 2 + by_row @ (north[:, 0] - answer_m[1]) ** 2
    positive = posterior[posterior > 0]
    confidence, covariance = _about(posterior, east, north, answer_m, max(TOLERANCE_M, 3 * cell_m))
    return PosteriorSummary(
        confidence=min(1.0, confidence),
        entropy_nats=float(-(positive * np.log(positive)).sum(dtype=np.float64)),
        sigma_m=math.sqrt(float(distance2) / 2.0),
        covariance_m2=covariance + np.eye(2) * cell_m**2 / 12.0,
    )


def _about(
    posterior: AnyFloats, east: FloatArray, north: FloatArray, answer_m: FloatArray, reach_m: float
) -> tuple[float, FloatArray]:
    """Return mass within reach of an answer, and its covariance ``(2, 2)`` about the answer."""
    near, east, north = _near(posterior, east, north, answer_m, reach_m)
    east, north = east - answer_m[0], north - answer_m[1]
    near = near * (east**2 + north**2 <= reach_m**2)
    mass = float(near.sum())
    weights = near / max(mass, 1e-12)
    across = float((weights * east * north).sum())
    return mass, np.array(
        [[(weights * east**2).sum(), across], [across, (weights * north**2).sum()]]
    )


def _near(
    posterior: AnyFloats, east: FloatArray, north: FloatArray, middle_m: FloatArray, reach_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the part of a grid that holds all within reach of ``middle_m``, and its offsets."""
    rows = np.flatnonzero(np.abs(north[:, 0] - middle_m[1]) <= reach_m)
    columns = np.flatnonzero(np.abs(east[0] - middle_m[0]) <= reach_m)
    down = slice(rows[0], rows[-1] + 1) if rows.size else slice(0)
    right = slice(columns[0], columns[-1] + 1) if columns.size else slice(0)
    return posterior[down, right].astype(np.float64), east[:, right], north[down]


def map_variance_m2(map_error_m: float, map_pixel_m: float) -> float:
    """Return the variance per axis that no frame can take away: registration, and the pixels."""
    return map_error_m**2 + (MAP_PIXEL_ERROR * map_pixel_m) ** 2


def ce90_of(covariance_m2: FloatArray) -> float:
    """Return the radius that holds 90 % of errors, as if they were normal and alike either way.

    ``sqrt(-2 ln 0.1)`` times the root mean square per axis (exact for a circular normal).
    """
    return math.sqrt(-2.0 * math.log(0.1) * float(np.trace(covariance_m2)) / 2.0)
