"""Correlation of every satellite cell with every thermal cell, and its lookup."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from uasthn_cli.matching.displacement.repeated_gather import RepeatedGather

RADIUS = 4
"""Cells looked at to each side, at every level."""

_SIDE = 2 * RADIUS + 1
CHANNELS_PER_LEVEL = _SIDE**2

_FAR_CELLS = 1e4
"""Where a lookup without a place (NaN) goes: outside every level."""


class CorrelationPyramid:
    """Levels ``(B, h * w, h / 2**l, w / 2**l)``: for each satellite cell, its thermal image.

    What is negative counts as 0 before it is pooled: as published. That is also why pooled thermal
    features could not stand in for the volume.
    """

    def __init__(self, levels: Sequence[Tensor]) -> None:
        """Take the levels, finest first."""
        self.levels = tuple(levels)
        self._gathers = [RepeatedGather(level.flatten(0, 1).flatten(1)) for level in self.levels]

    @classmethod
    def of(cls, satellite: Tensor, thermal: Tensor, level_count: int) -> "CorrelationPyramid":
        """Correlate features ``(B, C, h, w)`` with those of views ``(N * B, C, h, w)``.

        View ``n`` of sample ``b`` is number ``n * B + b``; satellite features are not repeated.
        """
        samples, channels, rows, columns = satellite.shape
        queries = satellite.flatten(2).mT
        views = thermal.reshape(-1, samples, channels, rows * columns)
        volume = torch.relu_(torch.matmul(queries, views))
        levels = [volume.reshape(len(thermal), rows * columns, rows, columns)]
        for _ in range(level_count - 1):
            levels.append(functional.avg_pool2d(levels[-1], 2))
        return cls(levels)

    def first(self, count: int) -> "CorrelationPyramid":
        """Return the pyramid of the first ``count`` images."""
        return CorrelationPyramid([level[:count] for level in self.levels])

    def look_up(self, places: Tensor) -> Tensor:
        """Return correlations around places ``(B, h, w, 2)``, in cells of the finest level.

        The result is ``(B, h, w, levels * 81)``; within a level the column varies slowest.
        """
        flat = torch.nan_to_num(places, nan=_FAR_CELLS).reshape(-1, 2)
        looked = [
            _around(gather, level.shape[-2:], flat / 2**number)
            for number, (gather, level) in enumerate(zip(self._gathers, self.levels, strict=True))
        ]
        return torch.cat(looked, dim=1).reshape(*places.shape[:3], -1)


def _around(gather: RepeatedGather, size: torch.Size, places: Tensor) -> Tensor:
    """Sample images of ``size`` ``(h, w)`` on lattices of 9 by 9 cells around places ``(n, 2)``.

    All 81 samples share their fractions of a cell, so 10 by 10 cells are fetched and blended once
    along each axis: four times fewer reads than sampling one by one.
    """
    height, width = size
    whole = places.floor()
    steps = torch.arange(-RADIUS, RADIUS + 2, device=places.device)
    columns, inside_x = _cells(whole[:, 0], steps, width)
    rows, inside_y = _cells(whole[:, 1], steps, height)
    index = (rows * width)[:, :, None] + columns[:, None, :]
    patches = gather(index.flatten(1)).reshape(index.shape)
    fraction = (places - whole).to(patches.dtype)
    across = _blend(patches * inside_x[:, None, :], fraction[:, 0, None, None], dim=2)
    sampled = _blend(across * inside_y[:, :, None], fraction[:, 1, None, None], dim=1)
    return sampled.mT.reshape(len(places), CHANNELS_PER_LEVEL)


def _cells(first: Tensor, steps: Tensor, count: int) -> Sequence[Tensor]:
    """Return cell numbers ``(n, 10)``, held inside the image, and which were inside it."""
    far = count + _SIDE
    cells = first.clamp(-far, far).long()[:, None] + steps
    return cells.clamp(0, count - 1), (cells >= 0) & (cells < count)


def _blend(values: Tensor, fraction: Tensor, dim: int) -> Tensor:
    """Interpolate between neighbours along a dimension."""
    count = values.shape[dim] - 1
    return torch.lerp(values.narrow(dim, 0, count), values.narrow(dim, 1, count), fraction)
