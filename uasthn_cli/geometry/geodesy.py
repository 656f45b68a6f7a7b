"""Between WGS 84 and metres on the ground: the only room that imports pyproj."""

from functools import lru_cache
from typing import Any

import numpy as np
from pyproj import CRS, Geod, Transformer
from pyproj.exceptions import CRSError, ProjError

from uasthn_cli.types import FloatArray

_GEOD = Geod(ellps="WGS84")


class LocalFrame:
    """Metres east and north around a point: transverse Mercator with true north at its centre.

    Within 20 km of the centre, scale is true to 5e-6 and grid north to 0.2° at mid latitudes.
    """

    def __init__(self, lat_deg: float, lon_deg: float) -> None:
        """Centre the frame on a WGS 84 position."""
        self.lat_deg, self.lon_deg = float(lat_deg), float(lon_deg)
        self.crs = CRS.from_proj4(
            f"+proj=tmerc +lat_0={self.lat_deg:.9f} +lon_0={self.lon_deg:.9f} +k=1 +x_0=0 +y_0=0"
            " +datum=WGS84 +units=m +no_defs"
        )
        self._to_local = _transformer(CRS.from_epsg(4326), self.crs)
        self._to_degrees = _transformer(self.crs, CRS.from_epsg(4326))

    def to_metres(self, lat_lon_deg: FloatArray) -> FloatArray:
        """Map ``(lat, lon)`` degrees ``(..., 2)`` to ``(east, north)`` metres."""
        lat_lon = np.asarray(lat_lon_deg, dtype=np.float64)
        east, north = self._to_local.transform(lat_lon[..., 1], lat_lon[..., 0])
        return np.stack([east, north], axis=-1)

    def to_degrees(self, metres: FloatArray) -> FloatArray:
        """Map ``(east, north)`` metres ``(..., 2)`` to ``(lat, lon)`` degrees."""
        points = np.asarray(metres, dtype=np.float64)
        lon, lat = self._to_degrees.transform(points[..., 0], points[..., 1])
        return np.stack([lat, lon], axis=-1)

    def wkt(self) -> str:
        """Return the frame's CRS as WKT, for readers that warp into it."""
        return str(self.crs.to_wkt())


def distance_m(a_lat_lon_deg: FloatArray, b_lat_lon_deg: FloatArray) -> FloatArray:
    """Return geodesic distances in metres between ``(lat, lon)`` degrees ``(..., 2)``."""
    a, b = np.broadcast_arrays(np.asarray(a_lat_lon_deg), np.asarray(b_lat_lon_deg))
    _, _, metres = _GEOD.inv(a[..., 1], a[..., 0], b[..., 1], b[..., 0])
    return np.asarray(metres, dtype=np.float64)


def to_crs(crs: Any, lat_lon_deg: FloatArray) -> FloatArray:
    """Map ``(lat, lon)`` degrees ``(..., 2)`` to ``(x, y)`` of any CRS that pyproj understands.

    Points outside the domain of the CRS come back infinite.

    Raises:
        ValueError: the CRS is not understood, or not tied to the earth.
    """
    lat_lon = np.asarray(lat_lon_deg, dtype=np.float64)
    transformer = _transformer(CRS.from_epsg(4326), _understood(crs))
    x, y = transformer.transform(lat_lon[..., 1], lat_lon[..., 0])
    return np.stack([x, y], axis=-1)


def from_crs(crs: Any, points: FloatArray) -> FloatArray:
    """Map ``(x, y)`` ``(..., 2)`` of any CRS that pyproj understands to ``(lat, lon)`` degrees.

    Points outside the domain of the CRS come back infinite.

    Raises:
        ValueError: the CRS is not understood, or not tied to the earth.
    """
    xy = np.asarray(points, dtype=np.float64)
    transformer = _transformer(_understood(crs), CRS.from_epsg(4326))
    lon, lat = transformer.transform(xy[..., 0], xy[..., 1])
    return np.stack([lat, lon], axis=-1)


def is_geographic(crs: Any) -> bool:
    """Tell whether a CRS counts in degrees.

    Raises:
        ValueError: the CRS is not understood.
    """
    return bool(_understood(crs).is_geographic)


def _understood(crs: Any) -> CRS:
    """Return the CRS meant by whatever pyproj understands."""
    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        raise ValueError(f"unknown coordinate reference system {crs!r}") from error


@lru_cache(maxsize=32)
def _transformer(source: CRS, target: CRS) -> Transformer:
    """Return the transformation between two CRS, x (east or longitude) first.

    Looking one up takes milliseconds, and a run asks for the same few again and again.
    """
    try:
        return Transformer.from_crs(source, target, always_xy=True)
    except ProjError as error:
        raise ValueError(f"no way from {source.name!r} to {target.name!r}") from error
