"""Frames on the ground: what composes frame, ortho, window and grid."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.geometry.camera import undistort_points
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.placement import Placement, box_origin, place_frame, translation
from uasthn_cli.types import CameraModel, FloatArray, GridBox, MapGrid

GRID = MapGrid(2.0)
CAMERA = CameraModel(64, 48, 60.0, 60.0, 31.5, 23.5)
NADIR = np.array([10.0, 20.0])


def similarity(heading_deg: float, scale: float = 0.5) -> FloatArray:
    """Return ``H_frame_grid`` of a nadir frame whose top points at a heading."""
    c, s = np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))
    return np.array([[scale * c, -scale * s, 7.0], [scale * s, scale * c, -3.0], [0.0, 0.0, 1.0]])


def place(heading_deg: float = 0.0, camera: CameraModel = CAMERA) -> Placement:
    return place_frame(camera, similarity(heading_deg), NADIR, GRID)


def test_convention_a_north_up_frame_lies_where_its_homography_says() -> None:
    placed = place()
    assert placed.corners_m == pytest.approx(
        np.array([[14.0, 6.0], [77.0, 6.0], [14.0, -41.0], [77.0, -41.0]])
    )
    assert placed.center_m == pytest.approx([45.5, -17.5])
    assert placed.camera_m == pytest.approx([20.0, -40.0])
    assert placed.gsd_m == pytest.approx(1.0)


@given(heading_deg=st.floats(-720.0, 720.0), mount_yaw_deg=st.floats(-180.0, 180.0))
def test_convention_the_heading_is_the_images_top_less_the_mount_yaw(
    heading_deg: float, mount_yaw_deg: float
) -> None:
    camera = replace(CAMERA, mount_yaw_rad=np.radians(mount_yaw_deg))
    yaw_deg = place(heading_deg, camera).yaw_deg
    assert 0.0 <= yaw_deg < 360.0
    difference = np.radians(yaw_deg + mount_yaw_deg - heading_deg)
    assert (np.cos(difference), np.sin(difference)) == pytest.approx((1.0, 0.0), abs=1e-6)


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
