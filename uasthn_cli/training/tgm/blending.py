"""Cut a large image into overlapping tiles and lay what comes of them over one another.

Weights rise linearly over the overlap and add up to one everywhere. Memory depends on the tile
alone: the image is done in strips of a few tiles' width, from top to bottom.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.types import GridBox

_STRIP_TILES: Final = 8

FloatImage = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Tiling:
    """Tiles along one side: where each begins, how long all are, and the weight of each pixel.

    ``weights`` ``(tiles, tile_px)`` add up to 1 at every pixel of the side.
    """

    length_px: int
    tile_px: int
    starts_px: tuple[int, ...]
    weights: FloatImage


def tile_side(length_px: int, tile_px: int, overlap_px: int) -> Tiling:
    """Cover a side with tiles that overlap by at least ``overlap_px``, none beyond its ends.

    A side shorter than a tile is one shorter tile.

    Raises:
        ValueError: tiles that overlap by half or more, or an empty side.
    """
    if length_px < 1 or not 0 <= overlap_px <= tile_px // 2:
        raise ValueError(f"no tiles of {tile_px} px with {overlap_px} px in common on {length_px}")
    tile_px = min(tile_px, length_px)
    last_px = length_px - tile_px
    starts = sorted({*range(0, last_px, max(1, tile_px - overlap_px)), last_px})
    from_edge = np.minimum(np.arange(tile_px), np.arange(tile_px)[::-1]) + 0.5
    ramp = np.minimum(from_edge / max(overlap_px, 0.5), 1.0)
    total = np.zeros(length_px)
    for start in starts:
        total[start : start + tile_px] += ramp
    weights = np.stack([ramp / total[start : start + tile_px] for start in starts])
    return Tiling(length_px, tile_px, tuple(starts), weights.astype(np.float32))


def tiles_to_render(columns: Tiling, rows: Tiling) -> int:
    """Return how often :func:`blend` renders: tiles on the seam of two strips count twice."""
    return len(rows.starts_px) * sum(len(strip.tiles) for strip in _strips(columns))


def blend(
    columns: Tiling, rows: Tiling, render: Callable[[GridBox], FloatImage]
) -> Iterator[tuple[GridBox, FloatImage]]:
    """Yield pieces that together cover the image once, blended from tiles ``(h, w)``."""
    for strip in _strips(columns):
        width_px = strip.stop_px - strip.first_px
        sums = np.zeros((rows.tile_px, width_px), dtype=np.float32)
        ends = (*rows.starts_px[1:], rows.length_px)
        for row, (top_px, end_px) in enumerate(zip(rows.starts_px, ends, strict=True)):
            for tile in strip.tiles:
                left_px = columns.starts_px[tile]
                image = render(GridBox(left_px, top_px, columns.tile_px, rows.tile_px))
                weighted = image * columns.weights[tile] * rows.weights[row][:, None]
                _add(sums, weighted, left_px - strip.first_px)
            done_px = end_px - top_px
            yield GridBox(strip.first_px, top_px, width_px, done_px), sums[:done_px].copy()
            sums[:-done_px] = sums[done_px:].copy()
            sums[len(sums) - done_px :] = 0.0


@dataclass(frozen=True, slots=True)
class _Strip:
    """Columns that are done together, and the numbers of the tiles that reach into them."""

    first_px: int
    stop_px: int
    tiles: tuple[int, ...]


def _strips(columns: Tiling) -> Iterator[_Strip]:
    edges = (*columns.starts_px[::_STRIP_TILES], columns.length_px)
    for first_px, stop_px in pairwise(edges):
        tiles = tuple(
            number
            for number, start_px in enumerate(columns.starts_px)
            if start_px < stop_px and start_px + columns.tile_px > first_px
        )
        yield _Strip(first_px, stop_px, tiles)


def _add(sums: FloatImage, image: FloatImage, left_px: int) -> None:
    """Add an image to sums of the same height, what sticks out on the sides left off."""
    first_px, stop_px = max(0, left_px), min(sums.shape[1], left_px + image.shape[1])
    sums[:, first_px:stop_px] += image[:, first_px - left_px : stop_px - left_px]
