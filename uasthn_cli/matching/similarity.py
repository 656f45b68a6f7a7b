"""Turn and scale of a frame against the map, by trying some of both in feature space.

A correlation is blind to a few degrees and a few per cent, yet its peak is highest where both are
right. The frame's features are turned and scaled by a small grid of hypotheses, each is correlated
with the map around the frame, and a paraboloid through the best scores gives the peak between them.
"""

import math
from collections.abc import Callable

import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor

from uasthn_cli.types import Similarity

_ROUNDS = ((2.5, 0.03), (1.0, 0.012), (0.5, 0.006))
"""Steps in degrees and in log scale: from what a log gets wrong to what a frame can tell."""

_SIDE = 3
_MOST_MOVES = 5
"""Grids of one step size, each centred on the best of the one before, until it lies inside."""

_LARGEST_DEG, _LARGEST_LOG = 8.0, 0.1
"""More than a log gets wrong: where the best lies here, nothing fits."""

Score = Callable[[Tensor, Tensor], Tensor]
"""Best scores ``(n,)`` of n hypotheses, given turned features and masks."""


def fit_similarity(score: Score, features: Tensor, mask: Tensor) -> Similarity | None:
    """Return the turn and scale of ``features`` ``(C, h, w)`` under which ``score`` is highest.

    ``mask`` ``(1, h, w)``; None where it lies beyond what a log gets wrong.
    """
    best: tuple[float, float] | None = (0.0, 0.0)
    for steps in _ROUNDS:
        best = best and _climbed(score, features, mask, best, steps)
    if best is None:
        return None
    return Similarity(math.radians(best[0]), math.exp(best[1]))


def _climbed(
    score: Score,
    features: Tensor,
    mask: Tensor,
    start: tuple[float, float],
    steps: tuple[float, float],
) -> tuple[float, float] | None:
    """Return degrees and log scale of the top near ``start``; None where there is none."""
    (yaw_deg, log_scale), (step_deg, step_log) = start, steps
    offsets = torch.arange(_SIDE, device=features.device, dtype=torch.float64) - _SIDE // 2
    grid = torch.cartesian_prod(offsets, offsets)
    for _ in range(_MOST_MOVES):
        yaw_rad = torch.deg2rad(yaw_deg + step_deg * grid[:, 0])
        turned, masks = _turned(features, mask, yaw_rad, log_scale + step_log * grid[:, 1])
        peak = paraboloid_peak(grid, score(turned, masks).double())
        yaw_deg, log_scale = yaw_deg + peak[0] * step_deg, log_scale + peak[1] * step_log
        if abs(yaw_deg) > _LARGEST_DEG or abs(log_scale) > _LARGEST_LOG:
            return None
        if max(map(abs, peak)) < 1.0:
            return yaw_deg, log_scale
    return None


def paraboloid_peak(steps: Tensor, scores: Tensor) -> tuple[float, float]:
    """Return the top of the paraboloid through ``scores`` ``(n,)`` at ``steps`` ``(n, 2)``.

    Fitted around the best score, which is the answer where the top is farther than a step from it.
    """
    best = steps[int(scores.argmax())]
    distance = (steps - best).norm(dim=1)
    weight = torch.exp(-0.5 * distance**2)[:, None]
    x, y = steps[:, 0], steps[:, 1]
    design = torch.stack([torch.ones_like(x), x, y, x * x, y * y, x * y], dim=1)
    solution = torch.linalg.lstsq(design * weight, scores[:, None] * weight).solution[:, 0]
    slope = solution[1:3]
    bend = torch.stack([2 * solution[3], solution[5], solution[5], 2 * solution[4]]).reshape(2, 2)
    if bool(torch.linalg.eigvalsh(bend).max() < 0):
        top = -torch.linalg.solve(bend, slope)
        if bool(((top - best).abs() <= 1.0).all()):
            best = top
    return float(best[0]), float(best[1])


def _turned(
    features: Tensor, mask: Tensor, yaw_rad: Tensor, log_scale: Tensor
) -> tuple[Tensor, Tensor]:
    """Return features ``(n, C, h, w)`` turned clockwise and enlarged about their middle, masks."""
    height, width = features.shape[-2:]
    ys = torch.arange(height, device=features.device) - (height - 1) / 2
    xs = torch.arange(width, device=features.device) - (width - 1) / 2
    y, x = torch.meshgrid(ys, xs, indexing="ij")
    shrink = torch.exp(-log_scale)[:, None, None]
    cosine, sine = torch.cos(yaw_rad)[:, None, None], torch.sin(yaw_rad)[:, None, None]
    source_x, source_y = shrink * (cosine * x + sine * y), shrink * (cosine * y - sine * x)
    grid = torch.stack([source_x * (2 / width), source_y * (2 / height)], dim=-1).to(features)
    stacked = torch.cat([features, mask]).expand(len(grid), -1, -1, -1)
    turned = F.grid_sample(stacked, grid, align_corners=False)
    masks = (turned[:, -1:] > 0.999).to(features)
    return turned[:, :-1], masks
