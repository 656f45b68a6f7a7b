"""Pinhole camera, attitude, and the ground plane.

Attitude follows MAVLink ``ATTITUDE``: roll, pitch, yaw in radians turn north-east-down into the
body (x forward, y right, z down; rotation order yaw, pitch, roll). A nadir camera looks along
body z with the image's top towards body x, turned by the mount yaw.
"""

import math

import cv2
import numpy as np

from uasthn_cli.types import Attitude, CameraModel, FloatArray


class HorizonError(ValueError):
    """Part of the image looks at or above the horizon, so it has no place on the ground."""


def rotation_ned_from_body(attitude: Attitude) -> FloatArray:
    """Return the rotation ``(3, 3)`` from body axes to north-east-down."""
    cr, sr = math.cos(attitude.roll_rad), math.sin(attitude.roll_rad)
    cp, sp = math.cos(attitude.pitch_rad), math.sin(attitude.pitch_rad)
    cy, sy = math.cos(attitude.yaw_rad), math.sin(attitude.yaw_rad)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


def attitude_from_rotation(rotation: FloatArray) -> Attitude:
    """Return roll, pitch, yaw of a rotation ``(3, 3)`` from body axes to north-east-down."""
    return Attitude(
        roll_rad=math.atan2(rotation[2, 1], rotation[2, 2]),
        pitch_rad=-math.asin(max(-1.0, min(1.0, float(rotation[2, 0])))),
        yaw_rad=math.atan2(rotation[1, 0], rotation[0, 0]),
    )


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


def homography_frame_ground(camera: CameraModel, attitude: Attitude, height_m: float) -> FloatArray:
    """Return ``H_frame_ground`` ``(3, 3)``: undistorted frame pixels to ground metres.

    Ground coordinates are ``(east_m, north_m)`` from the point straight below the camera, on a
    flat ground ``height_m`` below it.

    Raises:
        HorizonError: a corner of the frame does not look at the ground.
    """
    c, s = math.cos(camera.mount_yaw_rad), math.sin(camera.mount_yaw_rad)
    body_from_mount = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    mount_from_optical = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rays = (
        rotation_ned_from_body(attitude)
        @ body_from_mount
        @ mount_from_optical
        @ np.linalg.inv(camera_matrix(camera))
    )
    right, bottom = camera.width_px - 1.0, camera.height_px - 1.0
    corners = np.array([[0, 0, 1], [right, 0, 1], [0, bottom, 1], [right, bottom, 1]])
    if not (corners @ rays[2] > 1e-3).all():
        raise HorizonError("a corner of the frame looks above the horizon")
    H: FloatArray = np.stack([rays[1] * height_m, rays[0] * height_m, rays[2]])
    return H / float(H[2, 2])


def undistort_points(camera: CameraModel, points_px: FloatArray) -> FloatArray:
    """Return distorted frame pixels ``(n, 2)`` as pixels of the undistorted frame."""
    if not any(camera.distortion):
        return np.asarray(points_px, dtype=np.float64)
    K, distortion = camera_matrix(camera), np.asarray(camera.distortion)
    undistorted = cv2.undistortPoints(
        np.asarray(points_px, dtype=np.float64)[:, None], K, distortion, P=K
    )
    return np.asarray(undistorted[:, 0], dtype=np.float64)


def focal_from_hfov_px(width_px: int, hfov_deg: float) -> float:
    """Return the focal length in pixels of a horizontal field of view across the full width."""
    return width_px / 2.0 / math.tan(math.radians(hfov_deg) / 2.0)
