"""Windows of the map on the flight's own north-up grid."""

import logging
import math
import os
from functools import cached_property
from pathlib import Path
from types import TracebackType

import numpy as np
from rasterio.crs import CRS

from uasthn_cli.errors import MapElsewhereError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.mapping.georeference import Georeference
from uasthn_cli.mapping.radiometry import Scaling, find_scaling, find_statistics, sample_boxes
from uasthn_cli.mapping.raster import MapSource, fitting_overview, gdal_errors, open_source, warp
from uasthn_cli.types import (
    BoolArray,
    FloatArray,
    GridBox,
    ImageArray,
    MapGrid,
    MapStatistics,
    MapWindow,
)

_log = logging.getLogger(__name__)

_STATISTICS_REACH_M = 20_000.0
_SLOW_RATIO = 8.0


def native_gsd_m(path: Path, frame: LocalFrame) -> float:
    """Return the ground metres per map pixel near a flight, also for maps in degrees.

    Raises:
        MapUnreadableError: missing, corrupt, or not a raster that GDAL reads.
        MapWithoutCrsError: the map does not say where on earth it lies.
    """
    source = open_source(path)
    source.dataset.close()
    return source.place.gsd_m(_centre(frame))


class MapReader:
    """A map, read window by window at one GSD around a flight; a context manager.

    Memory does not depend on the size of the map: an overview is read where one fits, windows are
    warped piece by piece, and statistics come from a bounded sample.
    """

    grid: MapGrid

    def __init__(self, path: Path, frame: LocalFrame, gsd_m: float | None) -> None:
        """Open the map for reading at ``gsd_m``, or at its own resolution where that is None.

        Raises:
            MapUnreadableError: missing, corrupt, or not a raster that GDAL reads.
            MapWithoutCrsError: the map does not say where on earth it lies.
        """
        self._path, self._frame = path, frame
        full = open_source(path)
        full_gsd_m = full.place.gsd_m(_centre(frame))
        self.grid = MapGrid(full_gsd_m if gsd_m is None else gsd_m)
        self._opened = self._at_fitting_overview(full, full_gsd_m)
        self._opened_by = os.getpid()
        self._pixel_m = self._source.place.metres_per_pixel(_centre(frame))
        self._crs = CRS.from_wkt(frame.wkt())

    def __enter__(self) -> "MapReader":
        """Return the reader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._source.dataset.close()

    @property
    def _source(self) -> MapSource:
        """The open map, opened anew after a fork: processes must not share a file's position."""
        if self._opened_by != os.getpid():
            self._opened = open_source(self._path, self._level)
            self._opened_by = os.getpid()
        return self._opened

    @property
    def place(self) -> Georeference:
        """Where the raster that is read (the map or one of its overviews) lies."""
        return self._source.place

    def windows_id(self, content_sha256: str) -> str:
        """Return what windows show, without reading any: equal ones have equal windows in boxes.

        ``content_sha256`` is that of :func:`uasthn_cli.mapping.content.content_sha256`.
        """
        return repr((content_sha256, self._frame.wkt(), self.grid.gsd_m, self._pixel_m.tolist()))

    @property
    def statistics(self) -> MapStatistics:
        """Colour statistics of the map at this GSD, within 20 km of the flight.

        The deviation is the root of the channels' mean variance; all is 0 where no map is near.
        Maps of more than two million pixels at this GSD are sampled evenly.
        """
        return self._radiometry[1]

    def read(self, box: GridBox) -> MapWindow:
        """Return a window; pixels outside the map or without data are 0 and not valid.

        Raises:
            MapUnreadableError: the file is damaged where it was read.
        """
        scaling, statistics = self._radiometry
        raw, valid = self._warp(box)
        image = np.zeros((box.height_px, box.width_px, 3), dtype=np.float32)
        with np.errstate(over="ignore", invalid="ignore"):  # of values that are not valid
            np.copyto(image, scaling.apply(raw), where=valid[..., None])
        return MapWindow(image, valid, box, self.grid, statistics)

    def valid_fraction(self, box: GridBox) -> float:
        """Return the share of a box that the map covers with data.

        Raises:
            MapUnreadableError: the file is damaged where it was read.
        """
        return float(self._warp(box)[1].mean())

    def require_overlap(self, points_lat_lon_deg: FloatArray, radius_m: float) -> None:
        """Check that the map comes within ``radius_m`` of any of the places ``(n, 2)``.

        Raises:
            MapElsewhereError: it does not; says where map and flight are, and how far apart.
        """
        points = np.asarray(points_lat_lon_deg, dtype=np.float64)
        away_m = self._source.place.distance_m(points)
        if (away_m <= radius_m).any():
            return
        south, north, west, east = self._source.place.bounds_deg()
        (lat_min, lon_min), (lat_max, lon_max) = points.min(axis=0), points.max(axis=0)
        raise MapElsewhereError(
            f"{self._path}: the map lies at latitude {south:.4f} to {north:.4f}, longitude"
            f" {west:.4f} to {east:.4f}, the flight at latitude {lat_min:.4f} to {lat_max:.4f},"
            f" longitude {lon_min:.4f} to {lon_max:.4f}: {away_m.min() / 1000:.1f} km apart;"
            " give a map of the flight's area"
        )

    def _at_fitting_overview(self, full: MapSource, full_gsd_m: float) -> MapSource:
        """Return the map at the coarsest overview that the grid's GSD allows."""
        with gdal_errors(self._path, "open"):
            overviews = full.dataset.overviews(1)
        level = fitting_overview(overviews, full_gsd_m, self.grid.gsd_m)
        factor = 1 if level is None else overviews[level]
        _log.info(
            "%s: %d bands, %.3g m per pixel, read at %.3g m from %s",
            self._path,
            full.dataset.count,
            full_gsd_m,
            self.grid.gsd_m,
            "full resolution" if level is None else f"its overview at 1:{factor}",
        )
        if self.grid.gsd_m > _SLOW_RATIO * factor * full_gsd_m:
            _log.warning(
                "%s: the map is %.0f times finer than needed and has no overview to match;"
                " reading is faster after: gdaladdo -r average %s",
                self._path,
                self.grid.gsd_m / (factor * full_gsd_m),
                self._path,
            )
        self._level = level
        if level is None:
            return full
        full.dataset.close()
        return open_source(self._path, level)

    def _warp(self, box: GridBox) -> tuple[ImageArray, BoolArray]:
        with gdal_errors(self._path, "read"):
            return warp(self._source, self._crs, self._pixel_m, self.grid, box)

    @cached_property
    def _radiometry(self) -> tuple[Scaling, MapStatistics]:
        """How raw values become 0..1, and statistics thereafter: of one sample of the map."""
        boxes = []
        area = self._area()
        if area is not None:
            source_px = self.grid.gsd_m**2 / abs(float(np.linalg.det(self._pixel_m)))
            boxes = [self._warp(box) for box in sample_boxes(area, source_px)]
        samples = np.concatenate(
            [raw[valid] for raw, valid in boxes]
            or [np.zeros((0, len(self._source.colour_bands)), dtype=np.float32)]
        )
        scaling = find_scaling(self._source.dataset.dtypes[0], samples, str(self._path))
        return scaling, find_statistics(scaling.apply(samples))

    def _area(self) -> GridBox | None:
        """Return the box of grid pixels that holds the map's part near the flight."""
        extent = self._source.place.extent_near(self._frame, _STATISTICS_REACH_M)
        if extent is None:
            return None
        gsd_m = self.grid.gsd_m
        west, north = math.floor(extent.west_m / gsd_m), math.floor(-extent.north_m / gsd_m)
        east, south = math.ceil(extent.east_m / gsd_m), math.ceil(-extent.south_m / gsd_m)
        return GridBox(west, north, east - west + 1, south - north + 1)


def _centre(frame: LocalFrame) -> FloatArray:
    return np.array([frame.lat_deg, frame.lon_deg])
