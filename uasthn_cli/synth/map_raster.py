"""The satellite image as a GeoTIFF: tiled, compressed, with overviews, in any CRS."""

import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.transform import Affine, from_origin
from rasterio.warp import reproject

from uasthn_cli.errors import OutputError, SyntheticFlightError
from uasthn_cli.geometry.geodesy import LocalFrame, is_geographic, to_crs
from uasthn_cli.types import FloatArray

_METRES_PER_DEGREE = 111_320.0
_TILE_PX = 256
_JPEG_QUALITY = 80


@dataclass(frozen=True, slots=True)
class Ground:
    """Where a landscape's pixels lie: outer edges in metres of a local frame, metres a pixel."""

    frame: LocalFrame
    west_m: float
    north_m: float
    gsd_m: float
    width_px: int
    height_px: int

    @property
    def transform(self) -> Affine:
        """Pixel corners to metres east and north in the local frame."""
        return from_origin(self.west_m, self.north_m, self.gsd_m, self.gsd_m)

    def homography_ground_grid(self) -> FloatArray:
        """Return the homography ``(3, 3)`` from metres (east, north) to landscape pixels."""
        scale = 1.0 / self.gsd_m
        return np.array(
            [
                [scale, 0.0, -self.west_m * scale - 0.5],
                [0.0, -scale, self.north_m * scale - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )

    def edge_m(self, points: int = 65) -> FloatArray:
        """Return points ``(4, n, 2)`` along the west, east, north and south edges in metres."""
        east_m = self.west_m + self.width_px * self.gsd_m
        south_m = self.north_m - self.height_px * self.gsd_m
        across = np.linspace(self.west_m, east_m, points)
        down = np.linspace(south_m, self.north_m, points)
        return np.stack(
            [
                np.stack([np.full(points, self.west_m), down], axis=-1),
                np.stack([np.full(points, east_m), down], axis=-1),
                np.stack([across, np.full(points, self.north_m)], axis=-1),
                np.stack([across, np.full(points, south_m)], axis=-1),
            ]
        )


def write_map(
    path: Path, rgb: NDArray[np.uint8], ground: Ground, *, crs: str, gsd_m: float, jpeg: bool
) -> None:
    """Write a landscape's colours ``(h, w, 3)`` as a GeoTIFF in ``crs`` at ``gsd_m``.

    The map is the largest upright rectangle of that CRS that the landscape fills, so it has no
    empty pixels.

    Raises:
        SyntheticFlightError: the CRS is unknown or does not fit the place.
        OutputError: the file cannot be written.
    """
    transform, width, height = _map_grid(ground, crs, gsd_m)
    bands = np.zeros((3, height, width), dtype=np.uint8)
    reproject(
        np.ascontiguousarray(rgb.transpose(2, 0, 1)),
        bands,
        src_transform=ground.transform,
        src_crs=ground.frame.wkt(),
        dst_transform=transform,
        dst_crs=crs,
        resampling=Resampling.average if gsd_m >= 1.5 * ground.gsd_m else Resampling.cubic,
    )
    write_tiles(path, bands, transform, crs, jpeg=jpeg)


def write_tiles(
    path: Path, bands: NDArray[np.uint8], transform: Affine, crs: str, *, jpeg: bool
) -> None:
    """Write colours ``(3, h, w)`` as a tiled GeoTIFF with overviews, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        _write_raster(temporary, bands, transform, crs, jpeg=jpeg)
        temporary.replace(path)
    except (OSError, rasterio.errors.RasterioError) as error:
        raise OutputError(f"cannot write {path}: {error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _map_grid(ground: Ground, crs: str, gsd_m: float) -> tuple[Affine, int, int]:
    """Return transform, width and height of the largest upright map inside the landscape."""
    try:
        geographic = is_geographic(crs)
        west, east, north, south = to_crs(crs, ground.frame.to_degrees(ground.edge_m()))
    except ValueError as error:
        raise SyntheticFlightError(f"cannot write a map in {crs}: {error}") from error
    x0, x1 = float(west[:, 0].max()), float(east[:, 0].min())
    y0, y1 = float(south[:, 1].max()), float(north[:, 1].min())
    if not (math.isfinite(x0 + x1 + y0 + y1) and x0 < x1 and y0 < y1):
        raise SyntheticFlightError(f"cannot write a map in {crs}: the place lies outside it")
    step_y = gsd_m / _METRES_PER_DEGREE if geographic else gsd_m
    shrink = math.cos(math.radians(ground.frame.lat_deg)) if geographic else 1.0
    step_x = step_y / shrink
    width, height = math.floor((x1 - x0) / step_x), math.floor((y1 - y0) / step_y)
    return from_origin(x0, y1, step_x, step_y), max(1, width), max(1, height)


def _write_raster(
    path: Path, bands: NDArray[np.uint8], transform: Affine, crs: str, *, jpeg: bool
) -> None:
    """Write the raster and halve it until an overview fits one tile."""
    compression = (
        {"compress": "jpeg", "photometric": "ycbcr", "jpeg_quality": _JPEG_QUALITY}
        if jpeg
        else {"compress": "deflate", "predictor": 2}
    )
    count, height, width = bands.shape
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=width,
        height=height,
        count=count,
        dtype="uint8",
        crs=crs,
        transform=transform,
        tiled=True,
        blockxsize=_TILE_PX,
        blockysize=_TILE_PX,
        interleave="pixel",
        **compression,
    ) as raster:
        raster.write(bands)
    levels = [2**k for k in range(1, 8) if max(width, height) / 2 ** (k - 1) > _TILE_PX]
    if levels:
        with rasterio.open(path, "r+") as raster:
            raster.build_overviews(levels, Resampling.average)
