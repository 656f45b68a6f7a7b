"""A camera above a surface: from frame pixels to places on the ground, and back.

Heights are metres in whatever vertical datum the surface has; a camera's altitude is in the same
one. Places are ``(east, north)`` metres in the flight's local CRS.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from uasthn_cli.geometry.camera import ned_rays
from uasthn_cli.types import Attitude, CameraModel, FloatArray

_MAX_STEPS = 60
_STEP_END_M = 1e-5


class Surface(Protocol):
    """Ground whose height is known at some places."""

    def heights_m(self, points_m: FloatArray) -> FloatArray:
        """Return heights ``(...)`` at places ``(..., 2)``; NaN where there is none."""


@dataclass(frozen=True, slots=True)
class FlatGround:
    """Ground of one height everywhere."""

    height_m: float

    def heights_m(self, points_m: FloatArray) -> FloatArray:
        """Return the height, once for each place ``(..., 2)``."""
        return np.full(np.asarray(points_m).shape[:-1], self.height_m)


@dataclass(frozen=True, slots=True, eq=False)
class Relief:
    """Heights ``values_m`` ``(rows, columns)`` at the nodes of a north-up grid, NaN where unknown.

    Rows go south and columns east, ``step_m`` apart, from ``(west_m, north_m)``.
    """

    values_m: FloatArray
    west_m: float
    north_m: float
    step_m: float

    def heights_m(self, points_m: FloatArray) -> FloatArray:
        """Return heights ``(...)`` at places ``(..., 2)``: bilinear, NaN beside an unknown node."""
        points = np.asarray(points_m, dtype=np.float64)
        x = (points[..., 0] - self.west_m) / self.step_m
        y = (self.north_m - points[..., 1]) / self.step_m
        rows, columns = self.values_m.shape
        inside = (x >= 0) & (x <= columns - 1) & (y >= 0) & (y <= rows - 1)
        x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
        left = np.minimum(x.astype(np.intp), columns - 2)
        upper = np.minimum(y.astype(np.intp), rows - 2)
        right_share, lower_share = x - left, y - upper
        values = self.values_m
        above = _between(values[upper, left], values[upper, left + 1], right_share)
        below = _between(values[upper + 1, left], values[upper + 1, left + 1], right_share)
        return np.where(inside, _between(above, below, lower_share), np.nan)


@dataclass(frozen=True, slots=True)
class CameraOverSurface:
    """A posed camera, ``position_m`` ``(2,)`` and ``altitude_m``, above a surface.

    Where the surface has no height, the ground is taken to lie at ``plane_m``.
    """

    camera: CameraModel
    attitude: Attitude
    position_m: FloatArray
    altitude_m: float
    surface: Surface
    plane_m: float

    def to_ground(self, frame_px: FloatArray) -> FloatArray:
        """Return where the rays of undistorted frame pixels ``(..., 2)`` meet the surface.

        By fixed-point iteration, which settles where the ground is less steep than the rays: the
        product of the ground's slope and the tangent of a ray's angle to the vertical is below 1.

        Raises:
            HorizonError: a corner of the frame does not look at the ground.
        """
        pixels = np.asarray(frame_px, dtype=np.float64)
        ones = np.ones((*pixels.shape[:-1], 1))
        directions = (
            np.concatenate([pixels, ones], axis=-1) @ ned_rays(self.camera, self.attitude).T
        )
        per_metre_down = directions[..., 1::-1] / directions[..., 2:]
        ground_m = np.full(pixels.shape[:-1], self.plane_m)
        for _ in range(_MAX_STEPS):
            points_m = self.position_m + per_metre_down * (self.altitude_m - ground_m)[..., None]
            met_m = self.ground_m(points_m)
            if np.abs(met_m - ground_m).max(initial=0.0) < _STEP_END_M:
                break
            ground_m = met_m
        return np.asarray(points_m)

    def to_frame(self, points_m: FloatArray) -> FloatArray:
        """Return where places on the surface ``(..., 2)`` appear, in undistorted frame pixels.

        NaN for what is not in front of the camera. Whether something nearer hides a place is not
        asked: from above, hardly anything does.

        Raises:
            HorizonError: a corner of the frame does not look at the ground.
        """
        points = np.asarray(points_m, dtype=np.float64)
        east_north_m = points - self.position_m
        down_m = self.altitude_m - self.ground_m(points)
        directions = np.stack([east_north_m[..., 1], east_north_m[..., 0], down_m], axis=-1)
        pixels = directions @ np.linalg.inv(ned_rays(self.camera, self.attitude)).T
        is_seen = (pixels[..., 2:] > 0) & (down_m > 0)[..., None]
        return pixels[..., :2] / np.where(is_seen, pixels[..., 2:], np.nan)

    def ground_m(self, points_m: FloatArray) -> FloatArray:
        """Return the heights ``(...)`` that are taken for those of places ``(..., 2)``."""
        heights_m = self.surface.heights_m(points_m)
        return np.where(np.isfinite(heights_m), heights_m, self.plane_m)


def _between(first: FloatArray, second: FloatArray, share: FloatArray) -> FloatArray:
    """Return values ``share`` of the way from the first to the second."""
    return first + share * (second - first)
