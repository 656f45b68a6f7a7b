"""From raw map values to 0..1, and the map's colour statistics, from a bounded sample."""

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uasthn_cli.types import GridBox, ImageArray, MapStatistics

_log = logging.getLogger(__name__)

_MAX_SAMPLES = 2**21
_MAX_SOURCE_PX = 2**26
_BOX_PX = 512
_SAMPLES_PER_SIDE = 16
_MAX_SAMPLE_PX = 64
_ROBUST_PERCENT = (1.0, 99.0)


@dataclass(frozen=True, slots=True)
class Scaling:
    """The raw values that become 0 and 1."""

    low: float
    high: float

    def apply(self, raw: ImageArray) -> ImageArray:
        """Return raw values in 0..1, clipped."""
        scaled = (raw - np.float32(self.low)) / np.float32(self.high - self.low)
        return np.asarray(np.clip(scaled, 0.0, 1.0), dtype=np.float32)


def sample_boxes(area: GridBox, source_px_per_px: float) -> Iterator[GridBox]:
    """Yield boxes that cover an area, or, where it is large, an even lattice of small ones.

    What is read is bounded both in pixels of the grid and in pixels of the map, of which
    ``source_px_per_px`` lie in one pixel of the grid.
    """
    budget_px = min(_MAX_SAMPLES, int(_MAX_SOURCE_PX / max(1.0, source_px_per_px)))
    if area.width_px * area.height_px <= budget_px:
        yield from _cover(area)
        return
    side_px = min(_MAX_SAMPLE_PX, max(1, int(math.sqrt(budget_px)) // _SAMPLES_PER_SIDE))
    width_px, height_px = min(side_px, area.width_px), min(side_px, area.height_px)
    for row in _spread(area.row_px, area.height_px - height_px):
        for column in _spread(area.column_px, area.width_px - width_px):
            yield GridBox(column, row, width_px, height_px)


def find_scaling(dtype: str, samples: ImageArray, path: str) -> Scaling:
    """Return how raw values become 0..1: 8-bit as they are, others by robust percentiles.

    ``samples`` ``(n, channels)`` are valid raw values of the map.
    """
    if dtype == "uint8":
        return Scaling(0.0, 255.0)
    if not len(samples):
        return Scaling(0.0, 1.0)
    low, high = (float(value) for value in np.percentile(samples, _ROBUST_PERCENT))
    if high <= low:
        low, high = low - 0.5, low + 0.5
    _log.info("%s: %s values %g to %g become black to white", path, dtype, low, high)
    return Scaling(low, high)


def find_statistics(samples: ImageArray) -> MapStatistics:
    """Return statistics of samples ``(n, 1 or 3)`` in 0..1; all zero without any sample.

    The deviation is the root of the channels' mean variance.
    """
    if not len(samples):
        return MapStatistics((0.0, 0.0, 0.0), 0.0)
    mean = np.broadcast_to(samples.mean(axis=0, dtype=np.float64), 3)
    variance = samples.var(axis=0, dtype=np.float64).mean()
    return MapStatistics((float(mean[0]), float(mean[1]), float(mean[2])), float(np.sqrt(variance)))


def _cover(area: GridBox) -> Iterator[GridBox]:
    bottom, right = area.row_px + area.height_px, area.column_px + area.width_px
    for row in range(area.row_px, bottom, _BOX_PX):
        for column in range(area.column_px, right, _BOX_PX):
            yield GridBox(column, row, min(_BOX_PX, right - column), min(_BOX_PX, bottom - row))


def _spread(first_px: int, room_px: int) -> list[int]:
    """Return distinct starts of evenly spread samples, the first and last at the ends."""
    steps = np.linspace(first_px, first_px + room_px, _SAMPLES_PER_SIDE)
    return sorted({int(step) for step in np.floor(steps)})
