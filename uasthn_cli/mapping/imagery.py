"""Read whole overhead images (GeoTIFF, PNG, JPEG) as 8-bit colour, for training."""

import logging
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from affine import Affine
from numpy.typing import NDArray
from rasterio.enums import ColorInterp
from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window

from uasthn_cli.types import BoolArray

_log = logging.getLogger(__name__)

TILE_PX = 2048
"""Larger images are cut into tiles of this size."""

_MIN_VALID_SHARE = 0.5
_ROBUST_PERCENT = (1.0, 99.0)


@dataclass(frozen=True, slots=True)
class OverheadImage:
    """Colour ``(h, w, 3)`` uint8, and where it lies: CRS, origin, resolution.

    ``place`` is None where the file does not say, or is not north-up.
    """

    rgb: NDArray[np.uint8]
    place: tuple[str, float, float, float] | None


def read_overhead_tiles(path: Path) -> Iterator[OverheadImage]:
    """Yield an image as tiles of at most ``TILE_PX``.

    What cannot be read is logged and skipped, as are tiles of which less than half holds data.
    Grey images become colour, palettes are looked up, and values of more than 8 bits are scaled by
    each tile's robust percentiles.
    """
    try:
        with _open(path) as source:
            for window in _windows(source.width, source.height):
                valid = source.dataset_mask(window=window) > 0
                if valid.mean() >= _MIN_VALID_SHARE:
                    yield _read_tile(source, window, valid)
    except (RasterioError, CRSError) as error:
        detail = " ".join(str(error.__cause__ or error).split())
        _log.warning("%s: skipped, not a readable image (%s)", path, detail)


def _open(path: Path) -> rasterio.DatasetReader:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        source = rasterio.open(path)
    if source.count == 0:
        raise RasterioError("a container of several images")
    return source


def _windows(width_px: int, height_px: int) -> Iterator[Window]:
    for row in range(0, height_px, TILE_PX):
        for column in range(0, width_px, TILE_PX):
            yield Window(
                column, row, min(TILE_PX, width_px - column), min(TILE_PX, height_px - row)
            )


def _read_tile(source: rasterio.DatasetReader, window: Window, valid: BoolArray) -> OverheadImage:
    place = None
    transform = source.transform
    if source.crs is not None and _is_north_up(transform):
        west = window.col_off * transform.a + transform.c
        north = window.row_off * transform.e + transform.f
        place = (str(source.crs), float(west), float(north), float(transform.a))
    return OverheadImage(_read_colour(source, window, valid), place)


def _is_north_up(transform: Affine) -> bool:
    return bool(transform.b == transform.d == 0.0 and transform.a > 0.0 > transform.e)


def _read_colour(
    source: rasterio.DatasetReader, window: Window, valid: BoolArray
) -> NDArray[np.uint8]:
    if source.colorinterp[0] == ColorInterp.palette:
        palette = source.colormap(1)
        colours = np.zeros((max(palette) + 1, 3), np.uint8)
        colours[list(palette)] = [colour[:3] for colour in palette.values()]
        index = np.minimum(source.read(1, window=window), len(colours) - 1)
        return np.asarray(colours[index], dtype=np.uint8)
    pixels = source.read((1, 2, 3) if source.count >= 3 else (1, 1, 1), window=window)
    if np.iscomplexobj(pixels):
        raise RasterioError("complex numbers, not colours")
    if pixels.dtype != np.uint8:
        pixels = _as_8_bit(pixels, valid)
    return np.ascontiguousarray(np.moveaxis(pixels, 0, -1))


def _as_8_bit(pixels: NDArray[np.generic], valid: BoolArray) -> NDArray[np.uint8]:
    """Return pixels ``(3, h, w)`` with the robust range of the valid ones at 0..255."""
    values = pixels.astype(np.float64)
    usable = valid & np.isfinite(values)
    low, high = np.percentile(values[usable], _ROBUST_PERCENT) if usable.any() else (0.0, 1.0)
    scaled = np.clip((values - low) / max(high - low, 1e-9), 0, 1) * 255
    return np.where(usable, scaled, 0).astype(np.uint8)
