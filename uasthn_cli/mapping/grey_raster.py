"""Write a grey map piece by piece, whole or not at all."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import RasterioError
from rasterio.windows import Window

from uasthn_cli.errors import OutputError
from uasthn_cli.mapping.georeference import Georeference
from uasthn_cli.types import GridBox

NO_DATA: Final = 0
"""The value of pixels that show nothing; the file says so."""

_TILE_PX: Final = 256
_BLOCK_CACHE_BYTES: Final = 64 * 2**20


def write_grey_raster(
    path: Path, place: Georeference, pieces: Iterable[tuple[GridBox, NDArray[np.uint8]]]
) -> None:
    """Write pieces ``(h, w)`` of a map as a tiled GeoTIFF of one band that lies at ``place``.

    Raises:
        OutputError: the file cannot be written; what stood there before is untouched.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with rasterio.Env(GDAL_CACHEMAX=_BLOCK_CACHE_BYTES):
            _write(temporary, place, pieces)
        temporary.replace(path)
    except (OSError, RasterioError) as error:
        raise OutputError(f"cannot write {path}: {error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _write(
    path: Path, place: Georeference, pieces: Iterable[tuple[GridBox, NDArray[np.uint8]]]
) -> None:
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=place.width_px,
        height=place.height_px,
        count=1,
        dtype="uint8",
        crs=place.crs_wkt,
        transform=place.transform,
        nodata=NO_DATA,
        tiled=True,
        blockxsize=_TILE_PX,
        blockysize=_TILE_PX,
        compress="deflate",
        predictor=2,
        BIGTIFF="IF_SAFER",
    ) as raster:
        for box, pixels in pieces:
            window = Window(box.column_px, box.row_px, box.width_px, box.height_px)
            raster.write(pixels, 1, window=window)
