"""What a telemetry log says, as arrays: one family of messages per dataclass.

Times are kept as they were recorded, on two clocks: ``record_s`` is the ground station's (seconds
since 1970), ``boot_s`` the vehicle's (seconds since it booted). :mod:`uasthn_cli.ingest.timebase`
turns either into UTC.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.types import BoolArray, FloatArray

ABOVE_FIRST_FIX = "gps_altitude_above_first_fix"
"""Height source of a log that only has altitudes: the first fix is taken for take-off."""

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Stamps:
    """When ``n`` messages were recorded: arrays ``(n,)``.

    ``order`` is the ordinal of the record in the file, ``record_s`` the ground station's clock,
    ``boot_s`` the vehicle's time since boot, NaN where the message carries none.
    """

    order: IntArray
    record_s: FloatArray
    boot_s: FloatArray

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.order)


@dataclass(frozen=True, slots=True)
class Positions:
    """Positions ``(n,)`` in WGS 84; ``height_source`` names what ``height_m`` is counted from.

    ``alt_amsl_m`` is the altitude above mean sea level, NaN throughout where the log has none, and
    ``altitude_source`` the field that it is read from.
    """

    stamps: Stamps
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    alt_amsl_m: FloatArray
    message: str
    height_source: str
    altitude_source: str


@dataclass(frozen=True, slots=True)
class Attitudes:
    """MAVLink ``ATTITUDE`` of the vehicle's body, radians ``(n,)``."""

    stamps: Stamps
    roll_rad: FloatArray
    pitch_rad: FloatArray
    yaw_rad: FloatArray


@dataclass(frozen=True, slots=True)
class SystemTimes:
    """MAVLink ``SYSTEM_TIME``: the vehicle's idea of UTC ``(n,)``, as it stands in the log."""

    stamps: Stamps
    unix_s: FloatArray


@dataclass(frozen=True, slots=True)
class CameraEvents:
    """One family of camera messages ``(n,)``.

    ``unix_s`` is the exposure by the vehicle's clock where the message has one (else NaN),
    ``sequence`` the camera's own counter, ``file_names`` what the camera calls its files.
    """

    stamps: Stamps
    unix_s: FloatArray
    sequence: IntArray
    file_names: tuple[str, ...]
    message: str


@dataclass(frozen=True, slots=True)
class GimbalAttitudes:
    """How the camera's gimbal was turned: ``quaternion_xyzw`` ``(n, 4)`` of gimbal axes.

    Roll and pitch are against the horizon. Yaw is from true north where ``yaw_is_earth``, else
    from the vehicle's heading.
    """

    stamps: Stamps
    quaternion_xyzw: FloatArray
    yaw_is_earth: BoolArray
    message: str


@dataclass(frozen=True, slots=True)
class HeightSamples:
    """Heights over ground ``(n,)`` of one source; ``along_body_axis`` marks a slant range."""

    stamps: Stamps
    height_m: FloatArray
    source: str
    along_body_axis: bool


@dataclass(frozen=True, slots=True, eq=False)
class Telemetry:
    """Everything of one vehicle that a log holds and a prior needs.

    ``heights`` are in order of preference. ``vehicle`` is the MAVLink ``(system, component)`` whose
    positions are used.
    """

    path: Path
    vehicle: tuple[int, int]
    positions: Positions
    attitudes: Attitudes
    system_times: SystemTimes
    camera_events: tuple[CameraEvents, ...]
    gimbal: GimbalAttitudes | None
    heights: tuple[HeightSamples, ...]
