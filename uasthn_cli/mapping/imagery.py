"""Read whole overhead images (GeoTIFF, PNG, JPEG) as 8-bit colour, for training."""

import logging
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import NotGeoreferencedWarning, RasterioError, RasterioIOError
from rasterio.windows import Window

_log = logging.getLogger(__name__)

TILE_PX = 2048
"""Larger images are cut into tiles of this size, so that memory stays bounded per image."""


@dataclass(frozen=True, slots=True)
class OverheadImage:
    """Colour ``(h, w, 3)`` uint8, and where it lies (CRS, origin, resolution) or None."""

    rgb: NDArray[np.uint8]
    place: tuple[str, float, float, float] | None


def read_overhead_tiles(path: Path) -> Iterator[OverheadImage]:
    """Yield an image as tiles of at most ``TILE_PX``; unreadable files are logged and skipped."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path) as source:
                for window in _windows(source.width, source.height):
                    yield _read_tile(source, window)
    except (RasterioIOError, RasterioError) as error:
        _log.warning("%s: skipped, not a readable image (%s)", path, error)


def _windows(width_px: int, height_px: int) -> Iterator[Window]:
    for row in range(0, height_px, TILE_PX):
        for column in range(0, width_px, TILE_PX):
            yield Window(
                column, row, min(TILE_PX, width_px - column), min(TILE_PX, height_px - row)
            )


def _read_tile(source: rasterio.DatasetReader, window: Window) -> OverheadImage:
    bands = (1, 2, 3) if source.count >= 3 else (1, 1, 1)
    pixels = source.read(bands, window=window)
    if pixels.dtype != np.uint8:
        low, high = np.percentile(pixels, (1, 99))
        pixels = (np.clip((pixels - low) / max(high - low, 1e-9), 0, 1) * 255).astype(np.uint8)
    place = None
    if source.crs is not None:
        west, north = source.transform * (window.col_off, window.row_off)
        place = (str(source.crs), float(west), float(north), float(source.transform.a))
    return OverheadImage(np.ascontiguousarray(np.moveaxis(pixels, 0, -1)), place)
