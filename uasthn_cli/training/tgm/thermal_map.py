"""Draw the thermal image of a whole map, tile by tile."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.errors import OutputError, TrainingDataError
from uasthn_cli.mapping.colour_raster import ColourRaster
from uasthn_cli.mapping.grey_raster import NO_DATA, write_grey_raster
from uasthn_cli.outputs.atomic import remove_leftovers
from uasthn_cli.training.tgm.blending import FloatImage, Tiling, blend, tile_side, tiles_to_render
from uasthn_cli.training.tgm.thermal_generator import ThermalGenerator
from uasthn_cli.types import GridBox

_OVERLAP_SHARE: Final = 0.25
_FEWEST_PX, _MOST_PX = 16, 8192
"""Sides of a tile in map pixels: maps of much other resolution are refused."""


class ThermalMap:
    """The thermal image of a map, to be written by :meth:`write`.

    Tiles are as large on the ground as the images that the generator was trained on, and read at
    their resolution; a quarter of a tile overlaps the next, where both are blended. What is written
    has the map's own pixels and georeference.
    """

    def __init__(self, generator: ThermalGenerator, map_path: Path) -> None:
        """Open the map.

        Raises:
            MapUnreadableError: missing, corrupt, or not a raster that GDAL reads.
            MapWithoutCrsError: the map does not say where on earth it lies.
            TrainingDataError: the map is far finer or coarser than what the generator knows.
        """
        self._generator = generator
        self._map_path = map_path
        with ColourRaster(map_path) as raster:
            self._place = raster.place
            self._ratio = _map_pixels_per_pixel(generator, raster.gsd_m(), map_path)
        tile_px = round(generator.size_px * self._ratio)
        overlap_px = round(tile_px * _OVERLAP_SHARE)
        self._columns = tile_side(self._place.width_px, tile_px, overlap_px)
        self._rows = tile_side(self._place.height_px, tile_px, overlap_px)
        self.tiles = tiles_to_render(self._columns, self._rows)
        """How many tiles are drawn."""

    def write(
        self, out: Path, *, overwrite: bool = False, on_tile: Callable[[int], None] = lambda _: None
    ) -> None:
        """Write a GeoTIFF of one 8-bit band: 1 to 255, and 0, stated as no data, where the map is.

        ``on_tile`` is called with the number of tiles drawn so far.

        Raises:
            OutputError: the file exists (without ``overwrite``) or cannot be written.
            MapUnreadableError: the map is damaged.
        """
        _prepare(out, self._map_path, overwrite)
        with ColourRaster(self._map_path) as raster:
            drawn = self._blended(raster, self._columns, self._rows, on_tile)
            write_grey_raster(out, self._place, drawn)

    def _blended(
        self,
        raster: ColourRaster,
        columns: Tiling,
        rows: Tiling,
        on_tile: Callable[[int], None],
    ) -> Iterator[tuple[GridBox, NDArray[np.uint8]]]:
        done = 0

        def draw(box: GridBox) -> FloatImage:
            nonlocal done
            done += 1
            on_tile(done)
            return self._draw(raster, box)

        for box, values in blend(columns, rows, draw):
            grey = np.clip(np.rint(values), NO_DATA + 1, 255).astype(np.uint8)
            grey[~raster.valid(box)] = NO_DATA
            yield box, grey

    def _draw(self, raster: ColourRaster, box: GridBox) -> FloatImage:
        """Return the thermal image of one tile in map pixels; zeros where it holds no data."""
        if not raster.valid(box).any():
            return np.zeros((box.height_px, box.width_px), dtype=np.float32)
        size_px = (
            max(1, round(box.width_px / self._ratio)),
            max(1, round(box.height_px / self._ratio)),
        )
        thermal = self._generator.render(raster.read(box, size_px)).astype(np.float32)
        if size_px == (box.width_px, box.height_px):
            return thermal
        is_smaller = box.width_px < size_px[0]
        way = cv2.INTER_AREA if is_smaller else cv2.INTER_LINEAR
        sized = cv2.resize(thermal, (box.width_px, box.height_px), interpolation=way)
        return np.asarray(sized, dtype=np.float32)


def _map_pixels_per_pixel(generator: ThermalGenerator, map_gsd_m: float, map_path: Path) -> float:
    """Return how many map pixels (as a length) make one of the generator's; near 1 is 1."""
    if generator.is_own_scale(map_gsd_m):
        return 1.0
    ratio = generator.gsd_m / map_gsd_m
    if not _FEWEST_PX <= generator.size_px * ratio <= _MOST_PX:
        raise TrainingDataError(
            f"{map_path}: {map_gsd_m:.3g} m per pixel, while the generator was trained at"
            f" {generator.gsd_m:.3g} m; resample the map: gdalwarp -tr {generator.gsd_m:.3g}"
            f" {generator.gsd_m:.3g} -r average {map_path} OUT.tif"
        )
    return ratio


def _prepare(out: Path, map_path: Path, overwrite: bool) -> None:
    """Check that the map may be written; its folder is made."""
    if out.suffix.lower() not in (".tif", ".tiff"):
        raise OutputError(f"{out}: give --out a name that ends in .tif")
    if out.is_dir():
        raise OutputError(f"{out} is a folder; choose another --out")
    if out.exists() and out.samefile(map_path):
        raise OutputError(f"{out} is the map itself; choose another --out")
    if out.exists() and not overwrite:
        raise OutputError(f"{out} exists already: choose another --out, or add --overwrite")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot create {out.parent}: {error.strerror or error}") from error
    remove_leftovers(out)
