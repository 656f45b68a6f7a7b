"""Compose frame, ortho, window and grid into places on the earth."""

import math
from dataclasses import dataclass

import numpy as np

from uasthn_cli.geometry.camera import undistort_points
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.pixels import grid_to_metres
from uasthn_cli.types import CameraModel, FloatArray, GridBox, MapGrid


@dataclass(frozen=True, slots=True)
class Placement:
    """A frame on the ground: ``corners_m`` ``(4, 2)``, ``center_m``, ``camera_m``; local CRS."""

    corners_m: FloatArray
    center_m: FloatArray
    camera_m: FloatArray
    yaw_deg: float
    gsd_m: float

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
    camera: CameraModel, H_frame_grid: FloatArray, nadir_grid_px: FloatArray, grid: MapGrid
) -> Placement:
    """Place a frame by its homography onto the map grid.

    ``H_frame_grid`` ``(3, 3)`` maps undistorted frame pixels to grid pixels, ``nadir_grid_px``
    ``(2,)`` is the grid pixel below the camera. The heading is the direction of the image's top at
    its centre turned back by the mount yaw; the GSD the mean ground size of the centre pixel.
    """
    width_px, height_px = camera.width_px, camera.height_px
    center = np.array([[(width_px - 1) / 2, (height_px - 1) / 2]])
    around = center + np.array([[0, 0], [0, -0.5], [0, 0.5], [-0.5, 0], [0.5, 0]])
    frame_px = undistort_points(camera, np.vstack([image_corners_px(width_px, height_px), around]))
    ground = grid_to_metres(grid, transform_points(H_frame_grid, frame_px))
    corners, middle, (top, bottom, left, right) = ground[:4], ground[4], ground[5:]
    up, across = top - bottom, right - left
    heading_deg = math.degrees(math.atan2(up[0], up[1]) - camera.mount_yaw_rad) % 360
    return Placement(
        corners_m=corners,
        center_m=middle,
        camera_m=grid_to_metres(grid, nadir_grid_px),
        yaw_deg=heading_deg % 360,  # a tiny negative angle has become 360.0
        gsd_m=float((np.hypot(*up) + np.hypot(*across)) / 2),
    )
