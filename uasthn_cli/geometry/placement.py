"""Compose frame, ortho, window and grid into places on the earth."""

import math
from dataclasses import astuple, dataclass, replace

import numpy as np

from uasthn_cli.geometry.camera import undistort_points
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.pixels import grid_to_metres
from uasthn_cli.geometry.rotation import turned_attitude
from uasthn_cli.types import Attitude, CameraModel, FloatArray, GridBox, MapGrid


@dataclass(frozen=True, slots=True)
class Placement:
    """A frame on the ground: ``corners_m`` ``(4, 2)``, ``center_m``, ``camera_m``; local CRS.

    ``attitude`` is the camera's, the top of its image being forward; its yaw lies in 0..2π.
    """

    corners_m: FloatArray
    center_m: FloatArray
    camera_m: FloatArray
    attitude: Attitude
    gsd_m: float

    @property
    def angles_deg(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw of the camera."""
        roll_deg, pitch_deg, yaw_deg = map(math.degrees, astuple(self.attitude))
        return roll_deg, pitch_deg, yaw_deg

    def in_degrees(self, local: LocalFrame) -> FloatArray:
        """Return ``(lat, lon)`` of camera, centre and the four corners ``(6, 2)``."""
        return local.to_degrees(np.vstack([self.camera_m, self.center_m, self.corners_m]))


def translation(offset: FloatArray) -> FloatArray:
    """Return the homography ``(3, 3)`` that adds ``offset`` ``(2,)``."""
    H = np.eye(3)
    H[:2, 2] = offset
    return H


def box_origin(box: GridBox) -> FloatArray:
    """Return the grid pixel ``(2,)`` of a box's pixel (0, 0)."""
    return np.array([box.column_px, box.row_px], dtype=np.float64)


def place_frame(
    camera: CameraModel,
    attitude: Attitude,
    H_frame_grid: FloatArray,
    nadir_grid_px: FloatArray,
    grid: MapGrid,
) -> Placement:
    """Place a frame by its homography onto the map grid.

    ``attitude`` is the prior's, mount yaw not yet applied: the camera's roll and pitch are taken
    from it, yaw from the homography. ``H_frame_grid`` ``(3, 3)`` maps undistorted frame pixels to
    grid pixels, ``nadir_grid_px`` ``(2,)`` is the grid pixel below the camera. The GSD is the mean
    ground size of the centre pixel.
    """
    width_px, height_px = camera.width_px, camera.height_px
    center = np.array([[(width_px - 1) / 2, (height_px - 1) / 2]])
    around = center + np.array([[0, 0], [0, -0.5], [0, 0.5], [-0.5, 0], [0.5, 0]])
    frame_px = undistort_points(camera, np.vstack([image_corners_px(width_px, height_px), around]))
    ground = grid_to_metres(grid, transform_points(H_frame_grid, frame_px))
    corners, middle, (top, bottom, left, right) = ground[:4], ground[4], ground[5:]
    up, across = top - bottom, right - left
    logged = turned_attitude(attitude, camera.mount)
    yaw_rad = math.atan2(up[0], up[1]) - _top_direction_rad(logged.roll_rad, logged.pitch_rad)
    return Placement(
        corners_m=corners,
        center_m=middle,
        camera_m=grid_to_metres(grid, nadir_grid_px),
        # twice: a tiny negative angle becomes 2π
        attitude=replace(logged, yaw_rad=yaw_rad % math.tau % math.tau),
        gsd_m=float((np.hypot(*up) + np.hypot(*across)) / 2),
    )


def _top_direction_rad(roll_rad: float, pitch_rad: float) -> float:
    """Return where the image's top points on the ground, clockwise from the camera's yaw.

    A step towards body x from where body z meets the ground; 0 unless roll and pitch both are not.
    """
    return math.atan2(-math.sin(roll_rad) * math.sin(pitch_rad), math.cos(roll_rad))
