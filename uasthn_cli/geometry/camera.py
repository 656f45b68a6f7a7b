"""Pinhole camera and the ground plane.

A nadir camera looks along body z with the image's top towards body x, turned by the mount; body
axes are those of :mod:`uasthn_cli.geometry.rotation`.
"""

import math

import cv2
import numpy as np

from uasthn_cli.geometry.rotation import rotation_ned_from_body
from uasthn_cli.types import Attitude, CameraModel, FloatArray

_OPENCV_DISTORTION_LENGTHS = (4, 5, 8, 12, 14)
_UNDISTORTION_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-6)
"""OpenCV's default of five iterations is off by 0.04 px in the corners of a wide lens."""


class HorizonError(ValueError):
    """Part of the image looks at or above the horizon, so it has no place on the ground."""


def camera_matrix(camera: CameraModel) -> FloatArray:
    """Return the intrinsic matrix ``(3, 3)``."""
    return np.array(
        [
            [camera.focal_x_px, 0.0, camera.principal_x_px],
            [0.0, camera.focal_y_px, camera.principal_y_px],
            [0.0, 0.0, 1.0],
        ]
    )


def tilt_rad(attitude: Attitude) -> float:
    """Return the angle between a nadir camera's optical axis and the vertical."""
    return math.acos(max(-1.0, min(1.0, float(rotation_ned_from_body(attitude)[2, 2]))))


def ned_rays(camera: CameraModel, attitude: Attitude) -> FloatArray:
    """Return the matrix ``(3, 3)`` from undistorted frame pixels ``(x, y, 1)`` to directions.

    Directions are north, east, down from the camera, of no particular length.

    Raises:
        HorizonError: a corner of the frame does not look at the ground.
    """
    body_from_mount = rotation_ned_from_body(camera.mount)
    mount_from_optical = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rays: FloatArray = (
        rotation_ned_from_body(attitude)
        @ body_from_mount
        @ mount_from_optical
        @ np.linalg.inv(camera_matrix(camera))
    )
    right, bottom = camera.width_px - 1.0, camera.height_px - 1.0
    corners = np.array([[0, 0, 1], [right, 0, 1], [0, bottom, 1], [right, bottom, 1]])
    if not (corners @ rays[2] > 1e-3).all():
        raise HorizonError("a corner of the frame looks above the horizon")
    return rays


def homography_frame_ground(camera: CameraModel, attitude: Attitude, height_m: float) -> FloatArray:
    """Return ``H_frame_ground`` ``(3, 3)``: undistorted frame pixels to ground metres.

    Ground coordinates are ``(east_m, north_m)`` from the point straight below the camera, on a
    flat ground ``height_m`` below it.

    Raises:
        HorizonError: a corner of the frame does not look at the ground.
    """
    rays = ned_rays(camera, attitude)
    H: FloatArray = np.stack([rays[1] * height_m, rays[0] * height_m, rays[2]])
    return H / float(H[2, 2])


def distortion_coefficients(camera: CameraModel) -> FloatArray:
    """Return the distortion in OpenCV's order, filled with zeros to a length that OpenCV takes.

    Raises:
        ValueError: there are more than OpenCV's 14 coefficients.
    """
    given = len(camera.distortion)
    if given > _OPENCV_DISTORTION_LENGTHS[-1]:
        raise ValueError(f"{given} distortion coefficients; OpenCV knows at most 14")
    length = next(n for n in _OPENCV_DISTORTION_LENGTHS if n >= given)
    return np.array([*camera.distortion, *[0.0] * (length - given)], dtype=np.float64)


def undistort_points(camera: CameraModel, points_px: FloatArray) -> FloatArray:
    """Return distorted frame pixels ``(n, 2)`` as pixels of the undistorted frame."""
    points = np.asarray(points_px, dtype=np.float64)
    if not any(camera.distortion):
        return points
    undistorted = cv2.undistortImagePoints(
        points[:, None],
        camera_matrix(camera),
        distortion_coefficients(camera),
        None,
        _UNDISTORTION_CRITERIA,
    )
    return np.asarray(undistorted[:, 0], dtype=np.float64)


def focal_from_hfov_px(width_px: int, hfov_deg: float) -> float:
    """Return the focal length in pixels of a horizontal field of view across the full width."""
    return width_px / 2.0 / math.tan(math.radians(hfov_deg) / 2.0)
