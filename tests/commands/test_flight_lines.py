"""What a flight taught is told in the options that state it next time."""

import math

import numpy as np
import pytest

from uasthn_cli.commands.flight_lines import flight_lines, flight_record
from uasthn_cli.fusion.constants import Constant, FlightConstants
from uasthn_cli.fusion.offsets import OffsetGrid
from uasthn_cli.fusion.pose_smoother import SmoothedPoses
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.pipeline import FusedFlight

CAMERA = CameraSpec(hfov_deg=45.0, mount_yaw_deg=90.0)
YAW = Constant(math.radians(-2.5), math.radians(0.1), 12)
SCALE = Constant(math.log(1.04), 0.002, 12)
CLOCK = Constant(0.75, 0.1, 9)


def flight_with(constants: FlightConstants) -> FusedFlight:
    """Return a flight of no frames that taught this."""
    grid = OffsetGrid(1, 1.0)
    return FusedFlight((), np.zeros(0), np.zeros((0, 2)), [], grid, 3.0, constants, ())


def test_each_certain_constant_is_a_line_with_its_option() -> None:
    yaw, scale, clock = flight_lines(CAMERA, flight_with(FlightConstants(YAW, SCALE, CLOCK)))
    assert "-2.50° (± 0.10°)" in yaw
    assert "--mount-yaw 87.50" in yaw
    assert "+4.0 % (± 0.2 %)" in scale
    # tan(22.5°) * 1.04 is the tangent of 23.3°
    assert "--hfov 46.61" in scale
    assert "+0.75 s (± 0.10 s) too early" in clock
    assert "add +0.75 to --time-offset" in clock


def test_a_lens_that_was_not_given_by_its_field_of_view_gets_no_such_advice() -> None:
    camera = CameraSpec(focal_mm=18.0, pixel_pitch_um=12.0)
    (line,) = flight_lines(camera, flight_with(FlightConstants(log_scale=SCALE)))
    assert "+4.0 %" in line
    assert "--hfov" not in line


@pytest.mark.parametrize(
    "constants",
    [
        FlightConstants(),
        FlightConstants(yaw_rad=Constant(0.001, 0.001, 12), clock_s=Constant(0.75, 0.1, 5)),
    ],
)
def test_what_is_not_certain_is_not_said(constants: FlightConstants) -> None:
    assert flight_lines(CAMERA, flight_with(constants)) == []


def test_the_record_holds_values_errors_and_whether_they_were_corrected() -> None:
    unsure = Constant(0.1, 0.2, 4)
    record = flight_record(flight_with(FlightConstants(YAW, SCALE, unsure)))
    assert record == {
        "diffusion_m_per_sqrt_s": 3.0,
        "mount_yaw_deg": {"value": -2.5, "error": 0.1, "count": 12, "corrected": True},
        "height_log_scale": {"value": 0.039221, "error": 0.002, "count": 12, "corrected": True},
        "clock_s": {"value": 0.1, "error": 0.2, "count": 4, "corrected": False},
        "poses": None,
    }
    assert flight_record(flight_with(FlightConstants()))["mount_yaw_deg"] is None


def poses_with(roll: Constant, pitch: Constant) -> SmoothedPoses:
    """Return what two frames say of a mount that is turned by this."""
    covariances = np.tile(np.eye(2) * math.radians(0.5) ** 2, (2, 1, 1))
    return SmoothedPoses(np.zeros((2, 2)), covariances, roll, pitch, Constant(0.1, 0.2, 9), 4)


def test_what_was_corrected_of_the_mount_is_always_told() -> None:
    camera = CameraSpec(hfov_deg=45.0, mount_pitch_deg=1.0)
    unsure = Constant(math.radians(0.5), math.radians(0.4), 30)
    pitch = Constant(math.radians(-2.5), math.radians(0.3), 30)
    flight = flight_with(FlightConstants())
    (line,) = flight_lines(camera, flight, poses_with(unsure, pitch))
    assert "roll +0.50° (± 0.40°), pitch -2.50° (± 0.30°), corrected" in line
    assert "30 frames' places and 4 frames' perspective" in line
    assert line.endswith("next time: --mount-pitch -1.50")
    (line,) = flight_lines(camera, flight, poses_with(unsure, unsure))
    assert "corrected" in line
    assert "next time" not in line
    record = flight_record(flight, poses_with(unsure, pitch))["poses"]
    assert record == {
        "mount_roll_deg": {"value": 0.5, "error": 0.4},
        "mount_pitch_deg": {"value": -2.5, "error": 0.3},
        "clock_s": {"value": 0.1, "error": 0.2},
        "attitude_error_deg": 0.5,
        "frames_with_perspective": 4,
    }
