"""Frames on the ground: what composes frame, ortho, window and grid."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uasthn_cli.geometry.camera import homography_frame_ground, undistort_points
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.placement import Placement, box_origin, place_frame, translation
from uasthn_cli.types import Attitude, CameraModel, FloatArray, GridBox, MapGrid

GRID = MapGrid(2.0)
CAMERA = CameraModel(64, 48, 60.0, 60.0, 31.5, 23.5)
NADIR = np.array([10.0, 20.0])
LEVEL = Attitude(0.0, 0.0, 0.0)


def similarity(heading_deg: float, scale: float = 0.5) -> FloatArray:
    """Return ``H_frame_grid`` of a nadir frame whose top points at a heading."""
    c, s = np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))
    return np.array([[scale * c, -scale * s, 7.0], [scale * s, scale * c, -3.0], [0.0, 0.0, 1.0]])


def place(
    heading_deg: float = 0.0, camera: CameraModel = CAMERA, attitude: Attitude = LEVEL
) -> Placement:
    return place_frame(camera, attitude, similarity(heading_deg), NADIR, GRID)


def test_convention_a_north_up_frame_lies_where_its_homography_says() -> None:
    placed = place()
    assert placed.corners_m == pytest.approx(
        np.array([[14.0, 6.0], [77.0, 6.0], [14.0, -41.0], [77.0, -41.0]])
    )
    assert placed.center_m == pytest.approx([45.5, -17.5])
    assert placed.camera_m == pytest.approx([20.0, -40.0])
    assert placed.gsd_m == pytest.approx(1.0)


@given(heading_deg=st.floats(-720.0, 720.0), mount_yaw_deg=st.floats(-180.0, 180.0))
def test_convention_yaw_is_that_of_the_images_top_however_the_camera_is_mounted(
    heading_deg: float, mount_yaw_deg: float
) -> None:
    camera = replace(CAMERA, mount_yaw_rad=np.radians(mount_yaw_deg))
    _, _, yaw_deg = place(heading_deg, camera).angles_deg
    assert 0.0 <= yaw_deg < 360.0
    assert same_angles((yaw_deg,), (heading_deg,))


@given(
    angles_deg=st.tuples(*[st.floats(-25.0, 25.0)] * 2, st.floats(-180.0, 180.0)),
    mount_yaw_deg=st.floats(-180.0, 180.0),
)
def test_convention_roll_pitch_and_yaw_are_the_cameras_own_with_its_top_forward(
    angles_deg: tuple[float, float, float], mount_yaw_deg: float
) -> None:
    """SciPy turns the mount after the aircraft; the frame's own homography gives yaw."""
    camera = replace(CAMERA, mount_yaw_rad=np.radians(mount_yaw_deg))
    attitude = Attitude(*np.radians(angles_deg).tolist())
    H_frame_ground = homography_frame_ground(camera, attitude, 100.0)
    H_frame_grid = np.diag([1.0 / GRID.gsd_m, -1.0 / GRID.gsd_m, 1.0]) @ H_frame_ground
    placed = place_frame(camera, attitude, H_frame_grid, NADIR, GRID)
    turned = Rotation.from_euler("ZYX", angles_deg[::-1], degrees=True) * Rotation.from_euler(
        "Z", mount_yaw_deg, degrees=True
    )
    yaw_deg, pitch_deg, roll_deg = turned.as_euler("ZYX", degrees=True)
    assert same_angles(placed.angles_deg, (roll_deg, pitch_deg, yaw_deg))


def same_angles(found_deg: tuple[float, ...], expected_deg: tuple[float, ...]) -> bool:
    apart_deg = np.remainder(np.subtract(found_deg, expected_deg) + 180.0, 360.0) - 180.0
    return bool((np.abs(apart_deg) < 1e-4).all())


def test_corners_of_a_distorted_frame_are_undistorted_first() -> None:
    camera = replace(CAMERA, distortion=(-0.2, 0.05, 0.0, 0.0))
    corners_px = image_corners_px(64, 48)
    straight = undistort_points(camera, corners_px)
    expected = transform_points(similarity(0.0), straight) * (GRID.gsd_m, -GRID.gsd_m)
    placed = place(camera=camera)
    assert placed.corners_m == pytest.approx(expected)
    assert not np.allclose(placed.corners_m, place().corners_m, atol=1.0)
    assert placed.center_m == pytest.approx(place().center_m, abs=1e-3)


def test_degrees_come_as_camera_centre_corners() -> None:
    local = LocalFrame(47.0, 8.0)
    placed = place()
    degrees = placed.in_degrees(local)
    assert degrees.shape == (6, 2)
    metres = np.vstack([placed.camera_m, placed.center_m, placed.corners_m])
    assert local.to_metres(degrees) == pytest.approx(metres, abs=1e-6)


def test_a_box_begins_at_its_own_origin() -> None:
    H_window_grid = translation(box_origin(GridBox(-16, 32, 64, 48)))
    assert transform_points(H_window_grid, np.array([[0.0, 0.0], [3.0, 5.0]])) == pytest.approx(
        np.array([[-16.0, 32.0], [-13.0, 37.0]])
    )
