"""The flight's telemetry log: MAVLink 2 as an ArduPilot plane would send it."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.ingest.mavlink import TlogWriter
from uasthn_cli.synth.relief import MEAN_GROUND_AMSL_M
from uasthn_cli.synth.trajectory import SAMPLE_INTERVAL_S, NavigationError, Trajectory

_BOOT_BEFORE_START_S = 61.0
_SAMPLES_PER_ATTITUDE = round(0.1 / SAMPLE_INTERVAL_S)
_SAMPLES_PER_POSITION = round(0.2 / SAMPLE_INTERVAL_S)
_SAMPLES_PER_SECOND = round(1.0 / SAMPLE_INTERVAL_S)
_ATTITUDE_NOISE_RAD = math.radians(0.12)
_PLANE, _ARDUPILOT, _ARMED_AUTO, _ACTIVE, _AUTO_MODE = 1, 3, 209, 4, 10


class LogBook:
    """What the vehicle reports of one trajectory: erring positions, slightly noisy attitudes."""

    def __init__(
        self,
        rng: np.random.Generator,
        place: LocalFrame,
        trajectory: Trajectory,
        error: NavigationError,
        start_utc_s: float,
        take_off_m: float = 0.0,
    ) -> None:
        """Draw the noise; positions become degrees once, for all samples.

        Relative altitudes are above the take-off point, which lies ``take_off_m`` over the mean
        ground.
        """
        self._start_utc_s = start_utc_s
        self._trajectory = trajectory
        shifted = np.stack(
            [trajectory.east_m + error.east_m, trajectory.north_m + error.north_m], axis=-1
        )
        self._lat_lon_deg = place.to_degrees(shifted)
        self._height_m = (trajectory.height_m - take_off_m) * (1.0 + error.height_share)
        self._take_off_amsl_m = MEAN_GROUND_AMSL_M + take_off_m
        count = len(trajectory.times_s)
        noise = _ATTITUDE_NOISE_RAD * rng.standard_normal((3, count))
        self._roll_rad = trajectory.roll_rad + error.attitude_rad[0] + noise[0]
        self._pitch_rad = trajectory.pitch_rad + error.attitude_rad[1] + noise[1]
        self._yaw_rad = trajectory.yaw_rad + error.yaw_rad + error.attitude_rad[2] + noise[2]
        self._east_m_s = np.gradient(trajectory.east_m, SAMPLE_INTERVAL_S)
        self._north_m_s = np.gradient(trajectory.north_m, SAMPLE_INTERVAL_S)
        self._latency_s = 0.004 + 0.02 * rng.random(count)

    def write(self, path: Path, feedback_s: Iterable[tuple[int, float]]) -> None:
        """Write the log, with a CAMERA_FEEDBACK for each of the numbers and times given.

        Raises:
            OutputError: the file cannot be written.
        """
        feedback = list(feedback_s)
        with TlogWriter(path) as log:
            for index, time_s in enumerate(self._trajectory.times_s):
                record_s = self._start_utc_s + float(time_s) + float(self._latency_s[index])
                while feedback and feedback[0][1] <= time_s:
                    self._write_exposure(log, record_s, *feedback.pop(0))
                self._write_sample(log, record_s, index)

    def _write_sample(self, log: TlogWriter, record_s: float, index: int) -> None:
        """Write the messages that are due at one sample."""
        time_s = float(self._trajectory.times_s[index])
        if index % _SAMPLES_PER_SECOND == 0:
            log.write(
                record_s,
                "HEARTBEAT",
                type=_PLANE,
                autopilot=_ARDUPILOT,
                base_mode=_ARMED_AUTO,
                custom_mode=_AUTO_MODE,
                system_status=_ACTIVE,
                mavlink_version=3,
            )
            log.write(
                record_s,
                "SYSTEM_TIME",
                time_unix_usec=round((self._start_utc_s + time_s) * 1e6),
                time_boot_ms=_boot_ms(time_s),
            )
        if index % _SAMPLES_PER_ATTITUDE == 0:
            self._write_attitude(log, record_s, index)
        if index % _SAMPLES_PER_POSITION == 0:
            self._write_position(log, record_s, index)
            self._write_gps(log, record_s, index)

    def _write_attitude(self, log: TlogWriter, record_s: float, index: int) -> None:
        log.write(
            record_s,
            "ATTITUDE",
            time_boot_ms=_boot_ms(float(self._trajectory.times_s[index])),
            roll=float(self._roll_rad[index]),
            pitch=float(self._pitch_rad[index]),
            yaw=math.remainder(float(self._yaw_rad[index]), 2.0 * math.pi),
            rollspeed=0.0,
            pitchspeed=0.0,
            yawspeed=0.0,
        )

    def _write_position(self, log: TlogWriter, record_s: float, index: int) -> None:
        lat_deg, lon_deg = self._lat_lon_deg[index]
        height_m = float(self._height_m[index])
        log.write(
            record_s,
            "GLOBAL_POSITION_INT",
            time_boot_ms=_boot_ms(float(self._trajectory.times_s[index])),
            lat=round(lat_deg * 1e7),
            lon=round(lon_deg * 1e7),
            alt=round(1000.0 * (height_m + self._take_off_amsl_m)),
            relative_alt=round(1000.0 * height_m),
            vx=round(100.0 * float(self._north_m_s[index])),
            vy=round(100.0 * float(self._east_m_s[index])),
            vz=0,
            hdg=round(100.0 * math.degrees(float(self._yaw_rad[index]))) % 36_000,
        )

    def _write_gps(self, log: TlogWriter, record_s: float, index: int) -> None:
        """Write the receiver's own view: as off as the rest, and sure of itself."""
        lat_deg, lon_deg = self._lat_lon_deg[index]
        east, north = float(self._east_m_s[index]), float(self._north_m_s[index])
        time_s = float(self._trajectory.times_s[index])
        log.write(
            record_s,
            "GPS_RAW_INT",
            time_usec=round((self._start_utc_s + time_s) * 1e6),
            fix_type=3,
            lat=round(lat_deg * 1e7),
            lon=round(lon_deg * 1e7),
            alt=round(1000.0 * (float(self._height_m[index]) + self._take_off_amsl_m)),
            eph=90,
            epv=140,
            vel=round(100.0 * math.hypot(east, north)),
            cog=round(100.0 * math.degrees(math.atan2(east, north))) % 36_000,
            satellites_visible=14,
        )

    def _write_exposure(
        self, log: TlogWriter, record_s: float, sequence: int, time_s: float
    ) -> None:
        """Write one CAMERA_FEEDBACK with the vehicle's own idea of the pose."""
        times_s = self._trajectory.times_s
        lat_deg, lon_deg, height_m, roll, pitch, yaw = (
            float(np.interp(time_s, times_s, values))
            for values in (
                self._lat_lon_deg[:, 0],
                self._lat_lon_deg[:, 1],
                self._height_m,
                self._roll_rad,
                self._pitch_rad,
                self._yaw_rad,
            )
        )
        log.write(
            record_s,
            "CAMERA_FEEDBACK",
            time_usec=round((self._start_utc_s + time_s) * 1e6),
            target_system=0,
            cam_idx=0,
            img_idx=sequence,
            lat=round(lat_deg * 1e7),
            lng=round(lon_deg * 1e7),
            alt_msl=height_m + self._take_off_amsl_m,
            alt_rel=height_m,
            roll=math.degrees(roll),
            pitch=math.degrees(pitch),
            yaw=math.degrees(yaw) % 360.0,
            foc_len=0.0,
            flags=0,
        )


def _boot_ms(time_s: float) -> int:
    """Return the vehicle's milliseconds since boot."""
    return round(1000.0 * (time_s + _BOOT_BEFORE_START_S))
