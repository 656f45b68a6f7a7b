"""Ground that rises and falls: a smooth surface over the rendered area, and its DEM."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import rasterio
from rasterio.transform import from_origin
from scipy.ndimage import map_coordinates

from uasthn_cli.errors import OutputError, SyntheticFlightError
from uasthn_cli.geometry.geodesy import LocalFrame, from_crs, to_crs
from uasthn_cli.synth.map_raster import Ground
from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.types import FloatArray

MEAN_GROUND_AMSL_M: Final = 410.0
"""Height above sea level of the mean ground, and of all ground without relief."""

DEM_GSD_M: Final = 10.0
DEM_NODATA: Final = -9999.0

_LONGEST_WAVE_M = 1000.0
_SHORTEST_WAVE_M = 400.0
_ROUGHNESS = 0.35
_ROUNDING_M = 40.0
_STEEPEST = 0.5
_DEM_MARGIN_M = 200.0
_GRID_MARGIN_M = 300.0
_GRID_MARGIN_SHARE = 0.08
"""UTM's grid north is up to 3° off true north: the DEM's corners reach beyond the place's."""


@dataclass(frozen=True, slots=True)
class Relief:
    """Heights ``(h, w)`` in metres over the mean ground, bilinear between points of a grid.

    ``west_m`` and ``north_m`` are the place of the first point in the local frame; points lie
    :data:`DEM_GSD_M` apart. Beyond the grid its edge goes on.
    """

    west_m: float
    north_m: float
    heights_m: FloatArray

    def at(self, points_m: FloatArray) -> FloatArray:
        """Return the ground's height ``(...)`` over the mean at (east, north) ``(..., 2)``."""
        columns = (points_m[..., 0] - self.west_m) / DEM_GSD_M
        rows = (self.north_m - points_m[..., 1]) / DEM_GSD_M
        heights = map_coordinates(self.heights_m, [rows, columns], order=1, mode="nearest")
        return np.asarray(heights, dtype=np.float64)


def draw_relief(rng: np.random.Generator, ground: Ground, relief_m: float) -> Relief:
    """Draw ground of zero mean whose lowest and highest points in ``ground`` are so far apart.

    Raises:
        SyntheticFlightError: the ground is too small for such heights: they would be cliffs.
    """
    sides_m = ground.width_px * ground.gsd_m, ground.height_px * ground.gsd_m
    margin_m = _GRID_MARGIN_M + _GRID_MARGIN_SHARE * max(sides_m)
    columns, rows = (math.ceil((side + 2.0 * margin_m) / DEM_GSD_M) + 1 for side in sides_m)
    field = fractal_noise(
        rng,
        (rows, columns),
        DEM_GSD_M,
        _LONGEST_WAVE_M,
        roughness=_ROUGHNESS,
        finest_m=_SHORTEST_WAVE_M / 2.0,
    )
    field = smooth(field, _ROUNDING_M / DEM_GSD_M)
    west_m, north_m = ground.west_m - margin_m, ground.north_m + margin_m
    raw = Relief(west_m, north_m, field.astype(np.float64))
    inside = raw.at(_all_over(ground))
    heights = (raw.heights_m - inside.mean()) * (relief_m / np.ptp(inside))
    steepest = max(float(np.abs(np.diff(heights, axis=axis)).max()) for axis in (0, 1)) / DEM_GSD_M
    if steepest > _STEEPEST:
        raise SyntheticFlightError(
            f"relief of {relief_m:g} m over {min(sides_m) / 1000:.1f} × {max(sides_m) / 1000:.1f}"
            f" km has slopes of {math.degrees(math.atan(steepest)):.0f}°: take less relief or more"
            " frames"
        )
    return Relief(west_m, north_m, heights)


def _all_over(ground: Ground) -> FloatArray:
    """Return points ``(h, w, 2)`` in local metres all over a ground, half a DEM pixel apart."""
    edge_m = ground.edge_m(2).reshape(-1, 2)
    (west, south), (east, north) = edge_m.min(axis=0), edge_m.max(axis=0)
    columns, rows = (math.ceil(2.0 * side / DEM_GSD_M) + 1 for side in (east - west, north - south))
    x, y = np.meshgrid(np.linspace(west, east, columns), np.linspace(north, south, rows))
    return np.stack([x, y], axis=-1)


def write_dem(path: Path, relief: Relief, ground: Ground, crs: str) -> None:
    """Write heights above sea level as a GeoTIFF in a metric CRS, a margin around ``ground``.

    Raises:
        OutputError: the file cannot be written.
    """
    edge = to_crs(crs, ground.frame.to_degrees(ground.edge_m())).reshape(-1, 2)
    west, south = np.floor((edge.min(axis=0) - _DEM_MARGIN_M) / DEM_GSD_M) * DEM_GSD_M
    east, north = np.ceil((edge.max(axis=0) + _DEM_MARGIN_M) / DEM_GSD_M) * DEM_GSD_M
    transform = from_origin(west, north, DEM_GSD_M, DEM_GSD_M)
    x, y = np.meshgrid(
        np.arange(west, east, DEM_GSD_M) + DEM_GSD_M / 2.0,
        np.arange(north, south, -DEM_GSD_M) - DEM_GSD_M / 2.0,
    )
    heights = relief.at(_local_m(ground.frame, crs, np.stack([x, y], axis=-1)))
    try:
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            width=x.shape[1],
            height=x.shape[0],
            count=1,
            dtype="float32",
            crs=crs,
            transform=transform,
            nodata=DEM_NODATA,
            compress="deflate",
        ) as raster:
            raster.write((heights + MEAN_GROUND_AMSL_M).astype(np.float32), 1)
    except (OSError, rasterio.errors.RasterioError) as error:
        raise OutputError(f"cannot write {path}: {error}") from error


def _local_m(frame: LocalFrame, crs: str, points: FloatArray) -> FloatArray:
    """Return points ``(..., 2)`` of a CRS in metres of the local frame."""
    return frame.to_metres(from_crs(crs, points))
