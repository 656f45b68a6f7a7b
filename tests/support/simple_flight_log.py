"""Telemetry of a made-up flight whose true position and attitude are known at every instant."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uasthn_cli.ingest.mavlink import TlogWriter, read_telemetry
from uasthn_cli.ingest.telemetry import Telemetry

START_UTC_S = 1_700_000_000.0
LAT_DEG, LON_DEG = 47.0, 8.0
NORTH_DEG_S, EAST_DEG_S = 9e-5, 4e-5
HEIGHT_M = 120.0
TAKE_OFF_AMSL_M = 400.0


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """One flight and the faults of its clocks.

    ``record_error_s`` is the ground station's clock minus UTC, ``system_time_error_s`` the
    vehicle's (None: no SYSTEM_TIME), ``delay_s`` the largest random delay of the radio,
    ``amsl_m`` the take-off's altitude (None: the log does not know it).
    """

    start_utc_s: float = START_UTC_S
    duration_s: float = 60.0
    boot_before_start_s: float = 40.0
    record_error_s: float = 0.0
    system_time_error_s: float | None = 0.0
    delay_s: float = 0.02
    height_m: float = HEIGHT_M
    gap_s: tuple[float, float] = (0.0, 0.0)
    attitude: bool = True
    amsl_m: float | None = TAKE_OFF_AMSL_M


def true_lat_lon_deg(time_utc_s: float) -> tuple[float, float]:
    """Return where the vehicle truly is."""
    flown_s = time_utc_s - START_UTC_S
    return LAT_DEG + NORTH_DEG_S * flown_s, LON_DEG + EAST_DEG_S * flown_s


def true_angles_rad(time_utc_s: float) -> tuple[float, float, float]:
    """Return true roll, pitch and yaw; the yaw runs through ±180° several times a minute."""
    flown_s = time_utc_s - START_UTC_S
    yaw = math.remainder(math.radians(170.0 + 20.0 * flown_s), 2.0 * math.pi)
    return 0.1 * math.sin(flown_s), 0.05 * math.cos(flown_s), yaw


def write_flight(log: TlogWriter, plan: FlightPlan | None = None, seed: int = 0) -> None:
    """Write positions and attitudes at 5 Hz, SYSTEM_TIME at 1 Hz."""
    plan = plan or FlightPlan()
    delays_s = np.random.default_rng(seed).uniform(0.0, plan.delay_s, size=10_000)
    for index in range(round(plan.duration_s * 5)):
        time_s = index / 5.0
        if plan.gap_s[0] <= time_s < plan.gap_s[1]:
            continue
        utc_s = plan.start_utc_s + time_s
        record_s = utc_s + plan.record_error_s + float(delays_s[index % len(delays_s)])
        boot_ms = round((plan.boot_before_start_s + time_s) * 1000.0)
        if index % 5 == 0 and plan.system_time_error_s is not None:
            unix_usec = round((utc_s + plan.system_time_error_s) * 1e6)
            log.write(record_s, "SYSTEM_TIME", time_unix_usec=unix_usec, time_boot_ms=boot_ms)
        write_position(log, record_s, boot_ms, utc_s, plan.height_m, plan.amsl_m)
        if plan.attitude:
            write_attitude(log, record_s, boot_ms, utc_s)


def write_position(
    log: TlogWriter,
    record_s: float,
    boot_ms: int,
    utc_s: float,
    height_m: float = HEIGHT_M,
    amsl_m: float | None = TAKE_OFF_AMSL_M,
) -> None:
    """Write one GLOBAL_POSITION_INT of the true flight."""
    lat_deg, lon_deg = true_lat_lon_deg(utc_s)
    log.write(
        record_s,
        "GLOBAL_POSITION_INT",
        time_boot_ms=boot_ms,
        lat=round(lat_deg * 1e7),
        lon=round(lon_deg * 1e7),
        alt=round((0.0 if amsl_m is None else height_m + amsl_m) * 1000.0),
        relative_alt=round(height_m * 1000.0),
        vx=0,
        vy=0,
        vz=0,
        hdg=0,
    )


def write_attitude(log: TlogWriter, record_s: float, boot_ms: int, utc_s: float) -> None:
    """Write one ATTITUDE of the true flight."""
    roll, pitch, yaw = true_angles_rad(utc_s)
    log.write(
        record_s,
        "ATTITUDE",
        time_boot_ms=boot_ms,
        roll=roll,
        pitch=pitch,
        yaw=yaw,
        rollspeed=0.0,
        pitchspeed=0.0,
        yawspeed=0.0,
    )


def flight_telemetry(folder: Path, *plans: FlightPlan) -> Telemetry:
    """Write flights one after the other into one log and read it back."""
    path = folder / "flight.tlog"
    with TlogWriter(path) as log:
        for plan in plans or (FlightPlan(),):
            write_flight(log, plan)
    return read_telemetry(path)


def make_frame_files(folder: Path, times_utc_s: Sequence[float]) -> Path:
    """Create empty frame files that carry their time in milliseconds in their names."""
    frames = folder / "frames"
    frames.mkdir()
    for time_s in times_utc_s:
        (frames / f"frame_{round(time_s * 1000)}.png").touch()
    return frames
