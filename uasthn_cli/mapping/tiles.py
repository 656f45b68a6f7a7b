"""Map features, computed once per tile of the map and kept for the flight."""

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.config import MAX_TILE_BYTES
from uasthn_cli.geometry.pixels import cell_mask
from uasthn_cli.mapping.feature_store import FeatureStore, place_key, window_key
from uasthn_cli.seam import CacheableEncoder
from uasthn_cli.types import BoolArray, FloatArray, GridBox, MapFeatures, MapGrid, MapWindow

_ROUNDING = 1e-6

_Key: TypeAlias = tuple[int, int]
"""Column and row of a tile."""


@dataclass(frozen=True, slots=True)
class _Tile:
    """Features of one tile (None where nothing in it is valid) and which cells are valid."""

    values: NDArray[np.float16] | None
    valid: BoolArray
    grid: MapGrid

    @property
    def size_bytes(self) -> int:
        """Memory that it takes."""
        return self.valid.nbytes + (0 if self.values is None else self.values.nbytes)


@dataclass(frozen=True, slots=True)
class EncodingCache:
    """Where features are kept beyond the flight, and whose they are.

    ``map_id`` tells what windows on a grid show without reading them; None: it takes reading.
    """

    store: FeatureStore
    encoder: CacheableEncoder
    grid: MapGrid | None = None
    map_id: str | None = None


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
        max_bytes: int = MAX_TILE_BYTES,
        cache: EncodingCache | None = None,
    ) -> None:
        """Cut what ``read`` returns into tiles for ``encode``, keeping ``max_bytes`` of them.

        ``encode`` returns ``(channels, h / stride_px, w / stride_px)``. More is kept while a single
        box needs more. With a ``cache`` features are taken from there, and put there.

        Raises:
            ValueError: ``tile_px`` or ``halo_px`` is not a multiple of ``stride_px``.
        """
        if tile_px <= 0 or tile_px % stride_px or halo_px % stride_px:
            raise ValueError(f"tile {tile_px} and halo {halo_px} are no multiples of {stride_px}")
        self._read, self._encode, self._cache = read, encode, cache
        self._stride_px, self._halo_px, self._tile_px = stride_px, halo_px, tile_px
        self._max_bytes, self._kept_bytes = max_bytes, 0
        self._tiles: OrderedDict[_Key, _Tile] = OrderedDict()
        self._channels: int | None = None

    def read(self, box: GridBox) -> MapFeatures:
        """Return features (float16) of a box; zero in tiles without any valid cell.

        Raises:
            ValueError: position or size of the box is not a multiple of the stride.
        """
        stride = self._stride_px
        if any(side % stride for side in (box.column_px, box.row_px, box.width_px, box.height_px)):
            raise ValueError(f"{box} does not lie on multiples of {stride} pixels")
        keys = set(self._tiles_under(box))
        if not keys:
            raise ValueError(f"{box} is empty")
        tiles = {key: self._tile(key, keys) for key in sorted(keys)}
        shape = (box.height_px // stride, box.width_px // stride)
        valid = np.empty(shape, dtype=np.bool_)
        values = np.empty((self._channels or 0, *shape), dtype=np.float16)
        for key, tile in tiles.items():
            into, out_of = self._overlap(key, box)
            valid[into] = tile.valid[out_of]
            values[:, *into] = 0.0 if tile.values is None else tile.values[:, *out_of]
        return MapFeatures(values, valid, box, tile.grid, stride)

    def _tiles_under(self, box: GridBox) -> Iterator[_Key]:
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

    def _tile(self, key: _Key, needed: set[_Key]) -> _Tile:
        """Return a tile from memory, or make it and drop what has no room any more."""
        tile = self._tiles.get(key)
        if tile is not None:
            self._tiles.move_to_end(key)
            return tile
        tile = self._make_tile(key)
        self._tiles[key] = tile
        self._kept_bytes += tile.size_bytes
        self._drop_old(needed)
        return tile

    def _drop_old(self, needed: set[_Key]) -> None:
        """Drop the least recent tiles, but none of those needed, until the rest fits."""
        for key in [key for key in self._tiles if key not in needed]:
            if self._kept_bytes <= self._max_bytes:
                return
            self._kept_bytes -= self._tiles.pop(key).size_bytes

    def _make_tile(self, key: _Key) -> _Tile:
        """Return a tile that was kept for this very map, or read its window and encode that."""
        cache = self._cache
        if cache is None or cache.map_id is None or cache.grid is None:
            return self._tile_of_window(key)
        name = place_key(f"{cache.encoder.encoding_id} {self._cut} {cache.map_id} {key}")
        kept = cache.store.get(name)
        is_empty = kept is not None and len(kept) == 1
        if kept is not None and not (is_empty and self._channels is None):
            self._channels = self._channels if is_empty else len(kept) - 1
            return _Tile(None if is_empty else kept[:-1], kept[-1] > 0, cache.grid)
        tile = self._tile_of_window(key)
        valid = tile.valid[None].astype(np.float16)
        cache.store.put(
            name, valid if tile.values is None else np.concatenate([tile.values, valid])
        )
        return tile

    @property
    def _cut(self) -> tuple[int, int, int]:
        return self._tile_px, self._halo_px, self._stride_px

    def _tile_of_window(self, key: _Key) -> _Tile:
        """Encode a tile with its halo; the very first one always, to learn the channels."""
        size, halo, stride = self._tile_px, self._halo_px, self._stride_px
        side = size + 2 * halo
        window = self._read(GridBox(key[0] * size - halo, key[1] * size - halo, side, side))
        valid = cell_mask(window.valid[halo : halo + size, halo : halo + size], stride)
        if self._channels is not None and not valid.any():
            return _Tile(None, valid, window.grid)
        values = self._features(window)
        self._channels = len(values)
        return _Tile(values, valid, window.grid)

    def _features(self, window: MapWindow) -> NDArray[np.float16]:
        """Return the features of a tile from the cache, or encode its window and put them there."""
        if self._cache is None or self._cache.map_id is not None:
            return self._encoded(window)
        key = window_key(window, f"{self._cache.encoder.encoding_id} {self._cut}")
        values = self._cache.store.get(key)
        if values is None:
            values = self._encoded(window)
            self._cache.store.put(key, values)
        return values

    def _encoded(self, window: MapWindow) -> NDArray[np.float16]:
        encoded = self._encode(window)
        margin, cells = self._halo_px // self._stride_px, self._tile_px // self._stride_px
        cropped = encoded[:, margin : margin + cells, margin : margin + cells]
        return cropped.astype(np.float16)


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
