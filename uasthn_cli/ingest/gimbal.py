"""A gimbal's attitude as that of a body to which a nadir camera would be bolted."""

import numpy as np

from uasthn_cli.geometry.rotation import (
    attitude_from_rotation,
    rotation_between,
    rotation_from_quaternion,
    rotation_ned_from_body,
)
from uasthn_cli.ingest.clock import Clock
from uasthn_cli.ingest.interpolate import Track, make_track
from uasthn_cli.ingest.telemetry import GimbalAttitudes
from uasthn_cli.types import Attitude, FloatArray

_GIMBAL_FROM_BODY = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Axes of the equivalent body in gimbal axes.

A gimbal's x axis is the camera's optical axis, its -z axis the top of the image. A nadir camera
looks along body z with the image's top along body x: x of the body is -z of the gimbal, z is x.
"""


def gimbal_track(gimbal: GimbalAttitudes, clock: Clock) -> Track:
    """Return gimbal quaternions and their yaw's frame as a track ``(n, 5)``."""
    columns = (*gimbal.quaternion_xyzw.T, gimbal.yaw_is_earth.astype(np.float64))
    return make_track("gimbal attitude", clock, gimbal.stamps, columns)


def camera_attitude(track: Track, time_s: float, max_gap_s: float, body: Attitude) -> Attitude:
    """Return the attitude that a body with a rigid nadir camera would have.

    ``body`` is the vehicle's attitude at the same instant: its heading turns gimbals whose yaw is
    told relative to the vehicle. A gimbal straight down (pitch -90°) that is aligned with the
    heading gives roll 0, pitch 0 and the heading.

    Raises:
        OutsideLogError: the gimbal was not heard around the instant.
        AmbiguousTimeError: the instant lies in several flights of the log.
    """
    bracket = track.bracket(time_s, max_gap_s)
    before, after = (
        _ned_from_gimbal(sample[:4], bool(sample[4] > 0.5), body.yaw_rad)
        for sample in (bracket.before, bracket.after)
    )
    turn = rotation_between(before, after, bracket.fraction) @ _GIMBAL_FROM_BODY
    return attitude_from_rotation(turn)


def _ned_from_gimbal(quaternion_xyzw: FloatArray, earth: bool, heading_rad: float) -> FloatArray:
    own = rotation_from_quaternion(quaternion_xyzw)
    return own if earth else rotation_ned_from_body(Attitude(0.0, 0.0, heading_rad)) @ own
