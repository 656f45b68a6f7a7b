"""What an error of the attitude makes of the camera's position."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uasthn_cli.geometry.camera_error import camera_covariance_m2, camera_per_tilt_m
from uasthn_cli.types import Attitude, FloatArray

HEIGHT_M = 200.0


def camera_from_centre_m(attitude: Attitude, turn_rad: FloatArray) -> FloatArray:
    """Return the camera (east, north) of a frame whose centre lies at 0, by SciPy's rotations.

    ``turn_rad`` ``(2,)`` turns the camera about its own forward and right axes.
    """
    angles = (attitude.yaw_rad, attitude.pitch_rad, attitude.roll_rad)
    ned = Rotation.from_euler("ZYX", angles) * Rotation.from_rotvec([*turn_rad, 0.0])
    north, east, down = ned.apply([0.0, 0.0, 1.0])
    return np.array([-east / down, -north / down]) * HEIGHT_M


@given(
    roll_rad=st.floats(-0.4, 0.4),
    pitch_rad=st.floats(-0.4, 0.4),
    yaw_rad=st.floats(-3.2, 3.2),
)
def test_the_lever_is_how_the_camera_moves_under_a_small_turn(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> None:
    attitude = Attitude(roll_rad, pitch_rad, yaw_rad)
    step = 1e-5
    moved = [
        (camera_from_centre_m(attitude, turn) - camera_from_centre_m(attitude, -turn)) / (2 * step)
        for turn in np.eye(2) * step
    ]
    assert camera_per_tilt_m(attitude, HEIGHT_M) == pytest.approx(np.array(moved).T, abs=1e-3)


def test_convention_roll_moves_a_camera_to_the_right_and_pitch_backwards() -> None:
    """Heading east: the right is south, backwards is west."""
    east = Attitude(0.0, 0.0, np.pi / 2)
    assert camera_per_tilt_m(east, 100.0) == pytest.approx(np.array([[0, -100], [-100, 0]]))


def test_uncertain_roll_is_uncertain_across_the_heading() -> None:
    north_east = Attitude(0.0, 0.0, np.pi / 4)
    tilt = np.diag([0.02**2, 0.0])
    found = camera_covariance_m2(np.eye(2) * 9.0, tilt, north_east, 100.0)
    assert found == pytest.approx(np.array([[11.0, -2.0], [-2.0, 11.0]]))


def test_a_camera_that_looks_straight_down_for_sure_is_as_certain_as_the_centre() -> None:
    centre = np.array([[4.0, 1.0], [1.0, 9.0]])
    found = camera_covariance_m2(centre, np.zeros((2, 2)), Attitude(0.3, 0.1, 2.0), 300.0)
    assert found == pytest.approx(centre)
