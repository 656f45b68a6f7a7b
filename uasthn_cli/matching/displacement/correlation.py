"""Correlation of every satellite cell with every thermal cell, and its lookup."""

from collections.abc import Sequence

import torch
from torch import Tensor

from uasthn_cli.matching.displacement.pooling import mean_halved
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
            levels.append(mean_halved(levels[-1]))
        return cls(levels)

    def first(self, count: int) -> "CorrelationPyramid":
        """Return the pyramid of the first ``count`` images."""
        return CorrelationPyramid([level[:count] for level in self.levels])

    def look_up(self, places: Tensor) -> Tensor:
        """Return correlations around places ``(B, h, w, 2)``, in cells of the finest level.

        The result is ``(B, levels * 81, h, w)``; within a level the column varies slowest.
        """
        samples, rows, columns, _ = places.shape
        flat = torch.nan_to_num(places, nan=_FAR_CELLS).reshape(-1, 2).T.contiguous()
        looked = [
            _around(gather, level.shape[-2:], flat / 2**number)
            for number, (gather, level) in enumerate(zip(self._gathers, self.levels, strict=True))
        ]
        return torch.cat(looked).reshape(-1, samples, rows, columns).transpose(0, 1)


def _around(gather: RepeatedGather, size: torch.Size, places: Tensor) -> Tensor:
    """Sample images of ``size`` ``(h, w)`` on lattices of 9 by 9 cells around places ``(2, n)``.

    All 81 samples share their fractions of a cell, so 10 by 10 cells are fetched and blended once
    along each axis: four times fewer reads than sampling one by one. Fetched by image, which keeps
    to few pages of memory, and blended side by side, in long rows: the result is ``(81, n)``.
    """
    height, width = size
    whole = places.floor()
    columns, inside_x = _cells(whole[0], width)
    rows, inside_y = _cells(whole[1], height)
    index = columns[:, None] + (rows * width)[None]
    patches = gather(index.flatten(0, 1).T.long()).T.contiguous().reshape(index.shape)
    fraction_x, fraction_y = (places - whole).to(patches.dtype)
    across = _blend(patches * inside_y, fraction_y, dim=1) * inside_x[:, None]
    return _blend(across, fraction_x, dim=0).reshape(CHANNELS_PER_LEVEL, -1)


def _cells(first: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Return cell numbers ``(10, n)``, held inside the image, and which were inside it."""
    far = count + _SIDE
    steps = torch.arange(-RADIUS, RADIUS + 2, device=first.device, dtype=torch.int32)
    cells = first.clamp(-far, far).int() + steps[:, None]
    held = cells.clamp(0, count - 1)
    return held, cells == held


def _blend(values: Tensor, fraction: Tensor, dim: int) -> Tensor:
    """Interpolate between neighbours along a dimension."""
    count = values.shape[dim] - 1
    return torch.lerp(values.narrow(dim, 0, count), values.narrow(dim, 1, count), fraction)
