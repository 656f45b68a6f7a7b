"""Map features, computed once per tile of the map and kept for the flight."""

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.types import BoolArray, FloatArray, GridBox, MapFeatures, MapGrid, MapWindow

_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class _Tile:
    """Features of one tile (None where nothing in it is valid) and which cells are valid."""

    values: NDArray[np.float16] | None
    valid: BoolArray


class FeatureTiles:
    """Features of the map in tiles on multiples of ``tile_px`` of the grid, least recent dropped.

    A tile is encoded together with ``halo_px`` of its surroundings and cropped, so that features
    do not depend on how the map was cut, as long as the encoder looks no further than the halo and
    ``halo_px`` and ``tile_px`` are multiples of all its down-sampling.
    """

    def __init__(
        self,
        read: Callable[[GridBox], MapWindow],
        encode: Callable[[MapWindow], NDArray[np.floating[Any]]],
        *,
        stride_px: int,
        halo_px: int,
        tile_px: int = 256,
        max_tiles: int = 64,
    ) -> None:
        """Cut what ``read`` returns into tiles for ``encode``, keeping ``max_tiles`` of them.

        ``encode`` returns ``(channels, h / stride_px, w / stride_px)``. More tiles are kept while a
        single box needs more.

        Raises:
            ValueError: ``tile_px`` or ``halo_px`` is not a multiple of ``stride_px``.
        """
        if tile_px <= 0 or tile_px % stride_px or halo_px % stride_px:
            raise ValueError(f"tile {tile_px} and halo {halo_px} are no multiples of {stride_px}")
        self._read, self._encode = read, encode
        self._stride_px, self._halo_px, self._tile_px = stride_px, halo_px, tile_px
        self._max_tiles = max_tiles
        self._tiles: OrderedDict[tuple[int, int], _Tile] = OrderedDict()
        self._channels: int | None = None
        self._grid: MapGrid | None = None

    def read(self, box: GridBox) -> MapFeatures:
        """Return features (float32) of a box; zero in tiles without any valid cell.

        Raises:
            ValueError: position or size of the box is not a multiple of the stride.
        """
        stride = self._stride_px
        if any(side % stride for side in (box.column_px, box.row_px, box.width_px, box.height_px)):
            raise ValueError(f"{box} does not lie on multiples of {stride} pixels")
        keys = list(self._tiles_under(box))
        self._max_tiles = max(self._max_tiles, len(keys))
        shape = (box.height_px // stride, box.width_px // stride)
        valid = np.zeros(shape, dtype=np.bool_)
        values: NDArray[np.float32] | None = None
        for key in keys:
            tile = self._tile(key)
            if values is None:
                values = np.zeros((self._channels or 0, *shape), dtype=np.float32)
            into, out_of = self._overlap(key, box)
            valid[into] = tile.valid[out_of]
            if tile.values is not None:
                values[:, *into] = tile.values[:, *out_of]
        if values is None or self._grid is None:
            raise ValueError(f"{box} is empty")
        return MapFeatures(values, valid, box, self._grid, stride)

    def _tiles_under(self, box: GridBox) -> Iterator[tuple[int, int]]:
        """Yield (column, row) numbers of the tiles that a box touches."""
        size = self._tile_px
        for row in range(box.row_px // size, -(-(box.row_px + box.height_px) // size)):
            for column in range(box.column_px // size, -(-(box.column_px + box.width_px) // size)):
                yield column, row

    def _overlap(
        self, key: tuple[int, int], box: GridBox
    ) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Return the (row, column) slices of cells in the box and in the tile that coincide."""
        stride, cells = self._stride_px, self._tile_px // self._stride_px
        into, out_of = [], []
        for number, first_px, length_px in (
            (key[1], box.row_px, box.height_px),
            (key[0], box.column_px, box.width_px),
        ):
            shift = number * cells - first_px // stride
            start, stop = max(0, shift), min(length_px // stride, shift + cells)
            into.append(slice(start, stop))
            out_of.append(slice(start - shift, stop - shift))
        return (into[0], into[1]), (out_of[0], out_of[1])

    def _tile(self, key: tuple[int, int]) -> _Tile:
        """Return a tile from memory, or read and encode it."""
        if key in self._tiles:
            self._tiles.move_to_end(key)
            return self._tiles[key]
        tile = self._make_tile(key)
        self._tiles[key] = tile
        if len(self._tiles) > self._max_tiles:
            self._tiles.popitem(last=False)
        return tile

    def _make_tile(self, key: tuple[int, int]) -> _Tile:
        """Encode a tile with its halo; the very first one always, to learn the channels."""
        size, halo, stride = self._tile_px, self._halo_px, self._stride_px
        side = size + 2 * halo
        window = self._read(GridBox(key[0] * size - halo, key[1] * size - halo, side, side))
        self._grid = window.grid
        inner = window.valid[halo : halo + size, halo : halo + size]
        cells = size // stride
        blocks = inner.reshape(cells, stride, cells, stride)
        valid: BoolArray = np.logical_and.reduce(blocks, axis=(1, 3))
        if self._channels is not None and not valid.any():
            return _Tile(None, valid)
        encoded = self._encode(window)
        self._channels = len(encoded)
        margin = halo // stride
        cropped = encoded[:, margin : margin + cells, margin : margin + cells]
        return _Tile(cropped.astype(np.float16), valid)


def aligned_box(
    centre_px: FloatArray | tuple[float, float],
    width_px: float,
    height_px: float,
    multiple_px: int,
) -> GridBox:
    """Return the box of whole pixels around a size centred on grid point ``(x, y)``.

    Snapped outward, so that position and size are multiples of ``multiple_px``.
    """
    starts, lengths = [], []
    for centre, size in zip(centre_px, (width_px, height_px), strict=True):
        first_edge, last_edge = float(centre) - size / 2 + 0.5, float(centre) + size / 2 + 0.5
        start = math.floor(first_edge / multiple_px + _ROUNDING)
        stop = math.ceil(last_edge / multiple_px - _ROUNDING)
        starts.append(start * multiple_px)
        lengths.append((stop - start) * multiple_px)
    return GridBox(starts[0], starts[1], lengths[0], lengths[1])
