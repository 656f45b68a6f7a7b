"""Where a raster lies on the earth."""

from dataclasses import dataclass

import numpy as np
from affine import Affine

from uasthn_cli.geometry.corners import transform_points
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m, from_crs, to_crs
from uasthn_cli.types import FloatArray

_EDGE_POINTS = 33


@dataclass(frozen=True, slots=True)
class Extent:
    """A rectangle in metres of a flight's local CRS."""

    west_m: float
    north_m: float
    east_m: float
    south_m: float


@dataclass(frozen=True, slots=True)
class Georeference:
    """A raster's CRS (WKT), its affine transform (of pixel corners) and its size.

    Raster points follow the house convention: pixel centres on whole numbers.
    """

    crs_wkt: str
    transform: Affine
    width_px: int
    height_px: int

    def to_degrees(self, points_px: FloatArray) -> FloatArray:
        """Map raster points ``(..., 2)`` to ``(lat, lon)``; infinite where that has no meaning."""
        corners = np.asarray(points_px, dtype=np.float64) + 0.5
        return from_crs(self.crs_wkt, _apply(self.transform, corners))

    def to_pixels(self, lat_lon_deg: FloatArray) -> FloatArray:
        """Map ``(lat, lon)`` degrees ``(..., 2)`` to raster points; not finite where impossible."""
        place = to_crs(self.crs_wkt, lat_lon_deg)
        return _apply(~self.transform, np.where(np.isfinite(place), place, np.nan)) - 0.5

    def nearest(self, lat_lon_deg: FloatArray) -> FloatArray:
        """Return the points of the raster ``(..., 2)`` nearest to ``(lat, lon)``, in degrees.

        Nearest by the raster's own axes; the raster's middle where a place cannot be expressed in
        its CRS, or the nearest point has no place on earth.
        """
        size = np.array([self.width_px, self.height_px])
        points = np.clip(self.to_pixels(lat_lon_deg), -0.5, size - 0.5)
        nearest = self.to_degrees(points)
        on_earth = np.isfinite(nearest).all(axis=-1, keepdims=True)
        return np.where(on_earth, nearest, self.middle_deg())

    def distance_m(self, lat_lon_deg: FloatArray) -> FloatArray:
        """Return how far places ``(..., 2)`` are from the raster; 0 for places on it."""
        return distance_m(lat_lon_deg, self.nearest(lat_lon_deg))

    def metres_per_pixel(self, lat_lon_deg: FloatArray) -> FloatArray:
        """Return ``(2, 2)``: (east, north) metres on the ground per step in raster x and y.

        Taken at the point of the raster nearest to a place ``(2,)``.
        """
        start = self.to_pixels(self.nearest(lat_lon_deg))
        places = self.to_degrees(start + np.array([[-0.5, 0], [0.5, 0], [0, -0.5], [0, 0.5]]))
        metres = LocalFrame(*places.mean(axis=0)).to_metres(places)
        return np.stack([metres[1] - metres[0], metres[3] - metres[2]], axis=-1)

    def gsd_m(self, lat_lon_deg: FloatArray) -> float:
        """Return the side of a square of a pixel's area on the ground, nearest to a place."""
        return float(np.sqrt(abs(np.linalg.det(self.metres_per_pixel(lat_lon_deg)))))

    def middle_deg(self) -> FloatArray:
        """Return ``(lat, lon)`` of the raster's middle."""
        return self.to_degrees(np.array([self.width_px, self.height_px]) / 2 - 0.5)

    def bounds_deg(self) -> tuple[float, float, float, float]:
        """Return the southernmost and northernmost latitude and the two longitudes reached."""
        edge = self.to_degrees(_outline(-0.5, -0.5, self.width_px - 0.5, self.height_px - 0.5))
        places = np.concatenate([edge, self.middle_deg()[None]])
        places = places[np.isfinite(places).all(axis=-1)]
        (south, west), (north, east) = places.min(axis=0), places.max(axis=0)
        return float(south), float(north), float(west), float(east)

    def extent_near(self, frame: LocalFrame, reach_m: float) -> Extent | None:
        """Return the rectangle around the raster's part within ``reach_m``; None without any."""
        square = _outline(-reach_m, -reach_m, reach_m, reach_m)
        points = self.to_pixels(frame.to_degrees(square))
        points = points[np.isfinite(points).all(axis=-1)]
        if not len(points):
            return None
        last = np.array([self.width_px, self.height_px]) - 0.5
        first_px = np.maximum(points.min(axis=0), -0.5)
        last_px = np.minimum(points.max(axis=0), last)
        if (first_px >= last_px).any():
            return None
        edge = frame.to_metres(self.to_degrees(_outline(*first_px, *last_px)))
        edge = np.clip(edge[np.isfinite(edge).all(axis=-1)], -reach_m, reach_m)
        (west, south), (east, north) = edge.min(axis=0), edge.max(axis=0)
        return Extent(float(west), float(north), float(east), float(south))


def _apply(transform: Affine, points: FloatArray) -> FloatArray:
    return transform_points(np.array(tuple(transform)).reshape(3, 3), points)


def _outline(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    """Return points ``(n, 2)`` along a rectangle's sides, corners included."""
    t = np.linspace(0.0, 1.0, _EDGE_POINTS)
    x, y = x0 + (x1 - x0) * t, y0 + (y1 - y0) * t
    sides = [(x, 0 * t + y0), (x, 0 * t + y1), (0 * t + x0, y), (0 * t + x1, y)]
    return np.concatenate([np.stack(side, axis=-1) for side in sides])
