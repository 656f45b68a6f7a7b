"""Rotations as matrices, attitudes and quaternions.

Attitude follows MAVLink ``ATTITUDE``: roll, pitch, yaw in radians turn north-east-down into the
body (x forward, y right, z down; rotation order yaw, pitch, roll). Written out here because SciPy's
rotations take a quarter of a second to import, a fifth of what a run over one frame takes.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from uasthn_cli.types import Attitude, FloatArray

_GIMBAL_LOCK = 1e-9
"""Cosine of pitch below which roll and yaw cannot be told apart."""


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


def turned_attitude(attitude: Attitude, mount: Attitude) -> Attitude:
    """Return the attitude of axes that are turned by ``mount`` against a body's."""
    turn = rotation_ned_from_body(mount)
    return attitude_from_rotation(rotation_ned_from_body(attitude) @ turn)


def tilted_attitude(
    attitude: Attitude, mount: Attitude, roll_rad: float, pitch_rad: float
) -> Attitude:
    """Return a body's attitude after what is mounted on it was turned about its own axes.

    The mount stays as it is: the body takes the turn over.
    """
    turn = rotation_ned_from_body(mount)
    tilt = rotation_ned_from_body(Attitude(roll_rad, pitch_rad, 0.0))
    return attitude_from_rotation(rotation_ned_from_body(attitude) @ turn @ tilt @ turn.T)


def attitude_from_rotation(rotation: FloatArray) -> Attitude:
    """Return roll, pitch, yaw of a rotation ``(3, 3)`` from body axes to north-east-down.

    Pointing straight up or down, roll and yaw turn about the same axis: the turn is then given to
    yaw, and roll is 0.
    """
    cos_pitch = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch_rad = math.atan2(-rotation[2, 0], cos_pitch)
    if cos_pitch < _GIMBAL_LOCK:
        return Attitude(0.0, pitch_rad, math.atan2(-rotation[0, 1], rotation[1, 1]))
    return Attitude(
        roll_rad=math.atan2(rotation[2, 1], rotation[2, 2]),
        pitch_rad=pitch_rad,
        yaw_rad=math.atan2(rotation[1, 0], rotation[0, 0]),
    )


def rotation_between(before: FloatArray, after: FloatArray, fraction: float) -> FloatArray:
    """Return the rotation ``(3, 3)`` a fraction of the short way from one to the other."""
    part, _ = cv2.Rodrigues(_rotation_vector_rad(before.T @ after) * fraction)
    between: FloatArray = before @ part
    return between


def _rotation_vector_rad(rotation: FloatArray) -> FloatArray:
    """Return the vector along the axis of a rotation ``(3, 3)``, as long as its angle."""
    cosine = (float(np.trace(rotation)) - 1.0) / 2.0
    if cosine <= 0.0:
        vector_rad, _ = cv2.Rodrigues(rotation)
        return np.asarray(vector_rad, np.float64)[:, 0]
    # OpenCV takes turns below 1e-5 for none
    x, y, z = (rotation - rotation.T)[[2, 0, 1], [1, 2, 0]] / 2.0
    sine = math.hypot(x, y, z)
    return np.array([x, y, z]) * (math.atan2(sine, cosine) / sine if sine else 1.0)


def rotation_from_quaternion(xyzw: Sequence[float] | FloatArray) -> FloatArray:
    """Return the rotation ``(3, 3)`` of a quaternion ``(x, y, z, w)`` of any length but 0."""
    x, y, z, w = np.asarray(xyzw, np.float64) / np.linalg.norm(xyzw)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_attitude(attitude: Attitude) -> tuple[float, float, float, float]:
    """Return the quaternion ``(x, y, z, w)`` of :func:`rotation_ned_from_body`."""
    cr, sr = math.cos(attitude.roll_rad / 2), math.sin(attitude.roll_rad / 2)
    cp, sp = math.cos(attitude.pitch_rad / 2), math.sin(attitude.pitch_rad / 2)
    cy, sy = math.cos(attitude.yaw_rad / 2), math.sin(attitude.yaw_rad / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
