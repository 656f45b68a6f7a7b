"""Gimbal angles become those of a body with a rigid nadir camera."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from simple_flight_log import START_UTC_S, true_angles_rad, write_flight

from uasthn_cli.config import PriorConfig
from uasthn_cli.geometry.rotation import rotation_ned_from_body
from uasthn_cli.ingest.gimbal import camera_attitude
from uasthn_cli.ingest.interpolate import Segment, Track
from uasthn_cli.ingest.mavlink import TlogWriter, read_telemetry
from uasthn_cli.ingest.priors import build_priors
from uasthn_cli.types import Attitude, FrameFile, Prior

YAW_LOCK, VEHICLE_FRAME, EARTH_FRAME = 16, 32, 64
LEVEL = Attitude(0.0, 0.0, 0.0)


def steady(rotation: Rotation, earth: bool) -> Track:
    row = np.append(rotation.as_quat(), float(earth))
    return Track("gimbal attitude", (Segment(np.array([0.0, 1.0]), np.stack([row, row])),))


def gimbal(yaw_deg: float, pitch_deg: float, roll_deg: float = 0.0) -> Rotation:
    return Rotation.from_euler("ZYX", (yaw_deg, pitch_deg, roll_deg), degrees=True)


def close(attitude: Attitude, roll_deg: float, pitch_deg: float, yaw_deg: float) -> bool:
    found = np.degrees([attitude.roll_rad, attitude.pitch_rad, attitude.yaw_rad])
    return bool(np.allclose((found - (roll_deg, pitch_deg, yaw_deg) + 180) % 360, 180, atol=1e-6))


def test_convention_a_gimbal_straight_down_is_a_level_body() -> None:
    found = camera_attitude(steady(gimbal(30.0, -90.0), True), 0.5, 2.0, LEVEL)
    assert close(found, 0.0, 0.0, 30.0)


def test_convention_yaw_in_the_vehicle_frame_turns_with_the_heading() -> None:
    body = Attitude(0.2, -0.1, math.radians(100.0))
    found = camera_attitude(steady(gimbal(30.0, -90.0), False), 0.5, 2.0, body)
    assert close(found, 0.0, 0.0, 130.0)


def test_convention_looking_ahead_is_a_raised_nose() -> None:
    """A camera that looks 10° ahead of nadir sees what a bolted one sees at pitch +10°."""
    found = camera_attitude(steady(gimbal(0.0, -80.0), True), 0.5, 2.0, LEVEL)
    assert close(found, 0.0, 10.0, 0.0)
    optical_axis_ned = rotation_ned_from_body(found)[:, 2]
    np.testing.assert_allclose(
        optical_axis_ned, (math.sin(math.radians(10.0)), 0.0, math.cos(math.radians(10.0)))
    )


@given(
    roll=st.floats(-60.0, 60.0), pitch=st.floats(-60.0, 60.0), yaw=st.floats(-180.0, 180.0),
    heading=st.floats(-180.0, 180.0), earth=st.booleans(),
)  # fmt: skip
def test_the_bolted_body_comes_back(
    roll: float, pitch: float, yaw: float, heading: float, earth: bool
) -> None:
    """Axes of the gimbal: optical axis (body z) is x, right (body y) is y, image bottom is z."""
    body = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_matrix()
    axes = Rotation.from_matrix(np.column_stack([body[:, 2], body[:, 1], -body[:, 0]]))
    told = axes if earth else Rotation.from_euler("Z", heading, degrees=True).inv() * axes
    vehicle = Attitude(0.3, 0.2, math.radians(heading))
    assert close(camera_attitude(steady(told, earth), 0.5, 2.0, vehicle), roll, pitch, yaw)


@pytest.mark.parametrize(
    ("flags", "earth"),
    [
        (0, False),
        (YAW_LOCK, True),
        (YAW_LOCK | VEHICLE_FRAME, False),
        (EARTH_FRAME, True),
        (VEHICLE_FRAME, False),
    ],
)
def test_flags_tell_the_frame_of_yaw(tmp_path: Path, flags: int, earth: bool) -> None:
    path = tmp_path / "flight.tlog"
    x, y, z, w = gimbal(25.0, -90.0).as_quat()
    with TlogWriter(path) as log:
        write_flight(log)
        for index in range(120):
            log.write(
                START_UTC_S + 0.5 * index,
                "GIMBAL_DEVICE_ATTITUDE_STATUS",
                target_system=0,
                target_component=0,
                time_boot_ms=40_000 + 500 * index,
                flags=flags,
                q=[w, x, y, z],
                angular_velocity_x=0.0,
                angular_velocity_y=0.0,
                angular_velocity_z=0.0,
                failure_flags=0,
            )
    found = build_priors(
        read_telemetry(path),
        [FrameFile(f"{round((START_UTC_S + 20.0) * 1000)}.png", path)],
        config=PriorConfig(),
    )
    (prior,) = found.results
    assert isinstance(prior, Prior)
    assert found.attitude_source == "gimbal_device_attitude_status"
    heading_deg = 0.0 if earth else math.degrees(true_angles_rad(START_UTC_S + 20.0)[2])
    found_deg = math.degrees(prior.attitude.yaw_rad)
    assert math.remainder(found_deg - heading_deg - 25.0, 360.0) == pytest.approx(0.0, abs=0.5)
    assert abs(prior.attitude.roll_rad) + abs(prior.attitude.pitch_rad) < 1e-6


@pytest.mark.parametrize(("yaw_absolute", "earth"), [(77.0, True), (0.0, False)])
def test_mount_orientation(tmp_path: Path, yaw_absolute: float, earth: bool) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log)
        for index in range(20):
            angles = {"roll": math.nan, "pitch": -85.0, "yaw": 12.0, "yaw_absolute": yaw_absolute}
            boot_ms = 40_000 + 500 * index
            log.write(
                START_UTC_S + 0.5 * index, "MOUNT_ORIENTATION", time_boot_ms=boot_ms, **angles
            )
    telemetry = read_telemetry(path)
    assert telemetry.gimbal is not None
    assert telemetry.gimbal.message == "MOUNT_ORIENTATION"
    assert bool(telemetry.gimbal.yaw_is_earth[0]) is earth
    yaw_deg, pitch_deg, roll_deg = Rotation.from_quat(telemetry.gimbal.quaternion_xyzw[0]).as_euler(
        "ZYX", degrees=True
    )
    assert (pitch_deg, roll_deg) == pytest.approx((-85.0, 0.0), abs=1e-6)
    assert yaw_deg == pytest.approx(77.0 if earth else 12.0, abs=1e-5)
