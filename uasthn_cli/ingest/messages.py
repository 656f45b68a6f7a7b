"""Which fields of which MAVLink message a prior needs, in SI units (mavlink.io, common dialect).

Every function takes a decoded message and returns a :class:`Reading`, or None where the message
itself says that it is not valid.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from uasthn_cli.geometry.rotation import quaternion_from_attitude
from uasthn_cli.types import Attitude

_UNIX_USEC = 1e14
"""Time stamps above this count from 1970 (it is March 1973), those below from boot."""

_DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270
_CAPTURED = 1
_YAW_LOCK, _YAW_IN_VEHICLE_FRAME, _YAW_IN_EARTH_FRAME = 16, 32, 64  # GIMBAL_DEVICE_FLAGS
_MIN_FIX = 2  # GPS_FIX_TYPE_2D_FIX


@dataclass(frozen=True, slots=True)
class Reading:
    """One message: time since boot (NaN if it has none), its values, and its text if any."""

    boot_s: float
    values: tuple[float, ...]
    text: str = ""


def _is_place(lat_deg: float, lon_deg: float) -> bool:
    """Tell whether a position can be real: before a fix, autopilots send (0, 0)."""
    return abs(lat_deg) + abs(lon_deg) > 1e-4 and abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0


def _global_position(message: Any) -> Reading | None:
    lat_deg, lon_deg = message.lat * 1e-7, message.lon * 1e-7
    if not _is_place(lat_deg, lon_deg):
        return None
    values = (lat_deg, lon_deg, message.relative_alt * 1e-3, message.alt * 1e-3)
    return Reading(message.time_boot_ms * 1e-3, values)


def _gps_raw(message: Any) -> Reading | None:
    lat_deg, lon_deg = message.lat * 1e-7, message.lon * 1e-7
    if message.fix_type < _MIN_FIX or not _is_place(lat_deg, lon_deg):
        return None
    boot_s, _ = _split_usec(message.time_usec)
    alt_amsl_m = message.alt * 1e-3
    return Reading(boot_s, (lat_deg, lon_deg, alt_amsl_m, alt_amsl_m))


def _attitude(message: Any) -> Reading | None:
    angles = (message.roll, message.pitch, message.yaw)
    return Reading(message.time_boot_ms * 1e-3, angles) if _finite(angles) else None


def _system_time(message: Any) -> Reading | None:
    unix_s = message.time_unix_usec * 1e-6
    return Reading(message.time_boot_ms * 1e-3, (unix_s,)) if unix_s > 0 else None


def _camera_feedback(message: Any) -> Reading:
    boot_s, unix_s = _split_usec(message.time_usec)
    return Reading(boot_s, (unix_s, float(message.img_idx)))


def _camera_trigger(message: Any) -> Reading:
    boot_s, unix_s = _split_usec(message.time_usec)
    return Reading(boot_s, (unix_s, float(message.seq)))


def _camera_image_captured(message: Any) -> Reading | None:
    if message.capture_result != _CAPTURED:
        return None
    _, unix_s = _split_usec(message.time_utc)
    values = (unix_s, float(message.image_index))
    return Reading(message.time_boot_ms * 1e-3, values, str(message.file_url))


def _gimbal_device_attitude(message: Any) -> Reading | None:
    w, x, y, z = message.q
    if not _finite((w, x, y, z)) or not 0.5 < math.hypot(w, x, y, z) < 2.0:
        return None
    frame = message.flags & (_YAW_IN_EARTH_FRAME | _YAW_IN_VEHICLE_FRAME)
    # Before the two frame flags existed, the lock flag told the frame of yaw.
    earth = bool(frame & _YAW_IN_EARTH_FRAME if frame else message.flags & _YAW_LOCK)
    return Reading(message.time_boot_ms * 1e-3, (x, y, z, w, float(earth)))


def _mount_orientation(message: Any) -> Reading | None:
    if not math.isfinite(message.pitch):
        return None
    roll = message.roll if math.isfinite(message.roll) else 0.0
    # The extension field yaw_absolute reads 0 where the sender does not know it.
    earth = math.isfinite(message.yaw_absolute) and message.yaw_absolute != 0.0
    yaw = message.yaw_absolute if earth else message.yaw
    if not math.isfinite(yaw):
        return None
    attitude = Attitude(*map(math.radians, (roll, message.pitch, yaw)))
    quaternion = quaternion_from_attitude(attitude)
    return Reading(message.time_boot_ms * 1e-3, (*quaternion, float(earth)))


def _rangefinder(message: Any) -> Reading | None:
    if not (math.isfinite(message.distance) and message.distance > 0.0):
        return None
    return Reading(math.nan, (message.distance,))


def _distance_sensor(message: Any) -> Reading | None:
    in_range = message.min_distance < message.current_distance < message.max_distance
    if message.orientation != _DOWNWARD or not in_range:
        return None
    return Reading(message.time_boot_ms * 1e-3, (message.current_distance * 1e-2,))


def _terrain_report(message: Any) -> Reading | None:
    if message.spacing == 0 or not math.isfinite(message.current_height):
        return None
    return Reading(math.nan, (message.current_height,))


def _split_usec(usec: int) -> tuple[float, float]:
    """Return a time stamp as ``(boot_s, unix_s)``, one of which (or both, for 0) is NaN."""
    if usec == 0:
        return math.nan, math.nan
    return (math.nan, usec * 1e-6) if usec > _UNIX_USEC else (usec * 1e-6, math.nan)


def _finite(values: tuple[float, ...]) -> bool:
    return all(map(math.isfinite, values))


def _heartbeat(message: Any) -> None:
    """Hold nothing: a heartbeat only proves that a file is MAVLink."""


READERS: Final[dict[str, Callable[[Any], Reading | None]]] = {
    "HEARTBEAT": _heartbeat,
    "GLOBAL_POSITION_INT": _global_position,
    "GPS_RAW_INT": _gps_raw,
    "ATTITUDE": _attitude,
    "SYSTEM_TIME": _system_time,
    "CAMERA_FEEDBACK": _camera_feedback,
    "CAMERA_TRIGGER": _camera_trigger,
    "CAMERA_IMAGE_CAPTURED": _camera_image_captured,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": _gimbal_device_attitude,
    "MOUNT_ORIENTATION": _mount_orientation,
    "RANGEFINDER": _rangefinder,
    "DISTANCE_SENSOR": _distance_sensor,
    "TERRAIN_REPORT": _terrain_report,
}
"""By message name: what a prior takes from it."""
