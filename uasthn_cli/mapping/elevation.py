"""Elevation models: any raster of heights that GDAL reads, on a grid of the flight's own metres."""

import logging
import math
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import rasterio
from affine import Affine
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.warp import reproject

from uasthn_cli.errors import MapElsewhereError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.surface import Relief
from uasthn_cli.mapping.raster import MapSource, gdal_errors, open_source
from uasthn_cli.types import FloatArray

_log = logging.getLogger(__name__)

_ELEVATION_MODEL: Final = "elevation model"
_MAX_NODES_PER_SIDE = 2000
_WARP_TOLERANCE_PX = 0.02
_NODES_PER_PIXEL = 2
"""Between nodes heights are interpolated once more: as far apart as the model's, peaks wear off."""
_HIGHEST_M, _LOWEST_M = 9_000.0, -500.0
"""Beyond the highest and lowest land on earth: a code for missing data that is not declared."""
_SPOILT_NODES = 2 * _NODES_PER_PIXEL + 1
"""How far such a code reaches into the heights around it, as a square's side."""
_METRES_PER_UNIT: Final = {
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "us-ft": 1200 / 3937,
    "us survey foot": 1200 / 3937,
    "cm": 0.01,
    "dm": 0.1,
}


def read_relief(
    path: Path, frame: LocalFrame, points_lat_lon_deg: FloatArray, reach_m: float
) -> Relief:
    """Return the heights within ``reach_m`` of the box around places ``(n, 2)``, in metres.

    The grid is twice as fine as the model itself, coarser where that would be more than 2,000
    nodes a side. The first band counts; its scale, offset, unit and missing data are respected.

    Raises:
        MapUnreadableError: missing, corrupt, or not a raster that GDAL reads.
        MapWithoutCrsError: the model does not say where on earth it lies.
        MapElsewhereError: it has no height there.
    """
    source = open_source(path, what=_ELEVATION_MODEL)
    with source.dataset:
        places_m = frame.to_metres(np.asarray(points_lat_lon_deg, dtype=np.float64))
        first_m, last_m = places_m.min(axis=0) - reach_m, places_m.max(axis=0) + reach_m
        model_gsd_m = source.place.gsd_m(np.array([frame.lat_deg, frame.lon_deg]))
        coarsest_m = float((last_m - first_m).max()) / _MAX_NODES_PER_SIDE
        step_m = max(model_gsd_m / _NODES_PER_PIXEL, coarsest_m)
        columns, rows = (math.ceil(side / step_m) + 1 for side in last_m - first_m)
        west_m, north_m = float(first_m[0]), float(last_m[1])
        with gdal_errors(path, "read", _ELEVATION_MODEL):
            values_m = _warped(source, frame, (rows + 1, columns + 1), west_m, north_m, step_m)
    known = np.isfinite(values_m)
    if not known.any():
        raise MapElsewhereError(
            f"{path}: the elevation model has no height within {reach_m:.0f} m of the flight,"
            f" {source.place.distance_m(points_lat_lon_deg).min() / 1000:.1f} km from it; give one"
            " of the flight's area"
        )
    _log.info(
        "%s: heights of %.1f to %.1f m, %.3g m apart, known at %.0f %% of the nodes",
        path,
        np.nanmin(values_m),
        np.nanmax(values_m),
        step_m,
        100 * known.mean(),
    )
    return Relief(values_m, west_m, north_m, step_m)


def _warped(
    source: MapSource,
    frame: LocalFrame,
    shape: tuple[int, int],
    west_m: float,
    north_m: float,
    step_m: float,
) -> FloatArray:
    """Return heights ``shape`` at the nodes of a grid, NaN where the model has none."""
    dataset = source.dataset
    planes = np.full(shape, np.nan)
    missing = {"src_alpha": source.alpha_band} if source.alpha_band else {}
    reproject(
        rasterio.band(dataset, 1),
        planes,
        dst_transform=Affine(step_m, 0.0, west_m - step_m / 2, 0.0, -step_m, north_m + step_m / 2),
        dst_crs=CRS.from_wkt(frame.wkt()),
        dst_nodata=np.nan,
        resampling=Resampling.bilinear,
        tolerance=_WARP_TOLERANCE_PX,
        **missing,
    )
    factor = _METRES_PER_UNIT.get((dataset.units[0] or "").strip().lower(), 1.0)
    heights_m = (planes * dataset.scales[0] + dataset.offsets[0]) * factor
    impossible = (heights_m > _HIGHEST_M) | (heights_m < _LOWEST_M)
    if impossible.any():
        spoilt = cv2.dilate(impossible.astype(np.uint8), np.ones((_SPOILT_NODES, _SPOILT_NODES)))
        heights_m[spoilt > 0] = np.nan
    return np.asarray(heights_m, dtype=np.float64)
