"""Rotations, against SciPy's."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from uasthn_cli.geometry.rotation import (
    attitude_from_rotation,
    quaternion_from_attitude,
    rotation_between,
    rotation_from_quaternion,
    rotation_ned_from_body,
    tilted_attitude,
    turned_attitude,
)
from uasthn_cli.types import Attitude

angles = st.floats(-math.pi, math.pi)
pitches = st.floats(-1.5, 1.5)
attitudes = st.builds(Attitude, angles, pitches, angles)


@given(attitudes)
def test_rotation_is_yaw_then_pitch_then_roll(attitude: Attitude) -> None:
    expected = Rotation.from_euler(
        "ZYX", [attitude.yaw_rad, attitude.pitch_rad, attitude.roll_rad]
    ).as_matrix()
    np.testing.assert_allclose(rotation_ned_from_body(attitude), expected, atol=1e-12)


@given(attitudes)
def test_attitude_survives_the_round_trip(attitude: Attitude) -> None:
    again = attitude_from_rotation(rotation_ned_from_body(attitude))
    assert again.pitch_rad == pytest.approx(attitude.pitch_rad, abs=1e-9)
    for got, want in ((again.roll_rad, attitude.roll_rad), (again.yaw_rad, attitude.yaw_rad)):
        assert math.remainder(got - want, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@given(angles, st.sampled_from([-math.pi / 2, math.pi / 2]), angles)
def test_looking_along_the_vertical_keeps_the_rotation(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> None:
    rotation = rotation_ned_from_body(Attitude(roll_rad, pitch_rad, yaw_rad))
    again = rotation_ned_from_body(attitude_from_rotation(rotation))
    np.testing.assert_allclose(again, rotation, atol=1e-9)


@given(attitudes, attitudes, st.floats(0.0, 1.0))
def test_between_two_rotations_lies_the_great_circle(
    first: Attitude, second: Attitude, fraction: float
) -> None:
    before, after = rotation_ned_from_body(first), rotation_ned_from_body(second)
    pair = Rotation.from_matrix([before, after])
    assume((pair[0].inv() * pair[1]).magnitude() < math.pi - 1e-3)  # else two ways are as short
    expected = Slerp([0.0, 1.0], pair)(fraction).as_matrix()
    np.testing.assert_allclose(rotation_between(before, after, fraction), expected, atol=1e-6)


@given(attitudes, st.floats(0.5, 2.0))
def test_quaternions_are_those_of_the_attitude(attitude: Attitude, length: float) -> None:
    rotation = rotation_ned_from_body(attitude)
    quaternion = np.array(quaternion_from_attitude(attitude))
    np.testing.assert_allclose(rotation_from_quaternion(length * quaternion), rotation, atol=1e-12)
    expected = Rotation.from_matrix(rotation).as_quat()
    assert abs(float(expected @ quaternion)) == pytest.approx(1.0, abs=1e-12)


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_convention_a_tilted_body_tilts_its_camera_about_the_cameras_own_axes(
    roll_rad: float, pitch_rad: float, yaw_rad: float, mount_yaw_rad: float
) -> None:
    body, mount = Attitude(roll_rad, pitch_rad, yaw_rad), Attitude(0.02, -0.03, mount_yaw_rad)
    tilted = turned_attitude(tilted_attitude(body, mount, 0.04, -0.05), mount)
    camera = rotation_ned_from_body(turned_attitude(body, mount))
    expected = camera @ rotation_ned_from_body(Attitude(0.04, -0.05, 0.0))
    assert rotation_ned_from_body(tilted) == pytest.approx(expected, abs=1e-12)


def test_convention_a_mount_turns_first_then_pitches_then_rolls() -> None:
    """On a level aircraft that heads north the mount is the attitude."""
    camera = turned_attitude(Attitude(0.0, 0.0, 0.0), Attitude(0.1, 0.2, math.pi / 2))
    assert (camera.roll_rad, camera.pitch_rad, camera.yaw_rad) == pytest.approx(
        (0.1, 0.2, math.pi / 2)
    )
