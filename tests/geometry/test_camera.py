"""Attitude, pinhole and ground plane, against explicit ray casting and OpenCV's own projection."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uasthn_cli.geometry.camera import (
    HorizonError,
    camera_matrix,
    distortion_coefficients,
    focal_from_hfov_px,
    homography_frame_ground,
    tilt_rad,
    undistort_points,
)
from uasthn_cli.geometry.corners import transform_points
from uasthn_cli.types import Attitude, CameraModel, FloatArray

CAMERA = CameraModel(640, 512, 760.0, 770.0, 322.0, 250.0)
CENTRE = np.array([[CAMERA.principal_x_px, CAMERA.principal_y_px]])
LEVEL = Attitude(0.0, 0.0, 0.0)

angles = st.floats(-math.pi, math.pi)
small_tilts = st.floats(-0.3, 0.3)
nadir_attitudes = st.builds(Attitude, small_tilts, small_tilts, angles)


@given(nadir_attitudes)
def test_tilt_is_the_angle_of_the_optical_axis(attitude: Attitude) -> None:
    expected = math.cos(attitude.roll_rad) * math.cos(attitude.pitch_rad)
    assert math.cos(tilt_rad(attitude)) == pytest.approx(expected)


def cast_rays(
    camera: CameraModel, attitude: Attitude, height_m: float, pixels: FloatArray
) -> FloatArray:
    """Intersect the ray of each pixel with the ground, one axis of the camera at a time."""
    body_to_ned = Rotation.from_euler(
        "ZYX", [attitude.yaw_rad, attitude.pitch_rad, attitude.roll_rad]
    )
    mount = Rotation.from_euler("Z", camera.mount_yaw_rad)
    ground = []
    for x, y in pixels:
        right = (x - camera.principal_x_px) / camera.focal_x_px
        down_image = (y - camera.principal_y_px) / camera.focal_y_px
        forward_right_down = [-down_image, right, 1.0]
        north, east, down = body_to_ned.apply(mount.apply(forward_right_down))
        ground.append([east / down * height_m, north / down * height_m])
    return np.array(ground)


@given(nadir_attitudes, st.floats(1.0, 3000.0), angles)
def test_ground_homography_is_ray_casting(
    attitude: Attitude, height_m: float, mount_yaw_rad: float
) -> None:
    camera = replace(CAMERA, mount_yaw_rad=mount_yaw_rad)
    pixels = np.array([[0.0, 0.0], [639.0, 0.0], [0.0, 511.0], [639.0, 511.0], [123.4, 321.0]])
    H = homography_frame_ground(camera, attitude, height_m)
    np.testing.assert_allclose(
        transform_points(H, pixels),
        cast_rays(camera, attitude, height_m, pixels),
        atol=1e-9 * height_m,
    )


def test_convention_level_camera_sees_north_at_the_top_and_east_at_the_right() -> None:
    H = homography_frame_ground(CAMERA, LEVEL, 100.0)
    centre, right, below = transform_points(H, CENTRE + np.array([[0, 0], [76, 0], [0, 77]]))
    np.testing.assert_allclose(centre, [0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(right, [10.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(below, [0.0, -10.0], atol=1e-9)


@pytest.mark.parametrize("where", ["yaw", "mount"])
def test_convention_yaw_and_mount_yaw_turn_the_image_top_clockwise(where: str) -> None:
    quarter = math.pi / 2
    camera = replace(CAMERA, mount_yaw_rad=quarter) if where == "mount" else CAMERA
    attitude = replace(LEVEL, yaw_rad=quarter) if where == "yaw" else LEVEL
    H = homography_frame_ground(camera, attitude, 100.0)
    top, right = transform_points(H, CENTRE + np.array([[0, -77], [76, 0]]))
    np.testing.assert_allclose(top, [10.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(right, [0.0, -10.0], atol=1e-9)


def test_convention_nose_up_looks_ahead_and_right_wing_down_looks_left() -> None:
    ahead = transform_points(
        homography_frame_ground(CAMERA, replace(LEVEL, pitch_rad=0.1), 100.0), CENTRE
    )
    np.testing.assert_allclose(ahead, [[0.0, 100 * math.tan(0.1)]], atol=1e-9)
    left = transform_points(
        homography_frame_ground(CAMERA, replace(LEVEL, roll_rad=0.1), 100.0), CENTRE
    )
    np.testing.assert_allclose(left, [[-100 * math.tan(0.1), 0.0]], atol=1e-9)


def test_a_view_of_the_horizon_is_refused() -> None:
    with pytest.raises(HorizonError):
        homography_frame_ground(CAMERA, replace(LEVEL, pitch_rad=1.3), 100.0)
    with pytest.raises(HorizonError):
        homography_frame_ground(CAMERA, replace(LEVEL, roll_rad=math.pi), 100.0)


@given(st.integers(64, 4096), st.floats(5.0, 120.0))
def test_convention_field_of_view_spans_the_outer_edges(width_px: int, hfov_deg: float) -> None:
    focal_px = focal_from_hfov_px(width_px, hfov_deg)
    principal_px = (width_px - 1) / 2
    left, right = ((edge - principal_px) / focal_px for edge in (-0.5, width_px - 0.5))
    assert math.degrees(math.atan(right) - math.atan(left)) == pytest.approx(hfov_deg)


@pytest.mark.parametrize(
    "distortion", [(-0.35, 0.15, 0.001, -0.0005, -0.03), (0.2, -0.05), (-0.1,)]
)
def test_undistortion_undoes_opencv_projection(distortion: tuple[float, ...]) -> None:
    camera = replace(CAMERA, distortion=distortion)
    x, y = np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 511, 7))
    ideal: FloatArray = np.stack([x.ravel(), y.ravel()], axis=-1).astype(np.float64)
    K = camera_matrix(camera)
    rays = np.c_[ideal, np.ones(len(ideal))] @ np.linalg.inv(K).T
    distorted, _ = cv2.projectPoints(
        rays[:, None], np.zeros(3), np.zeros(3), K, distortion_coefficients(camera)
    )
    points: FloatArray = np.asarray(distorted[:, 0], dtype=np.float64)
    np.testing.assert_allclose(undistort_points(camera, points), ideal, atol=1e-4)


def test_without_distortion_points_stay_where_they_are() -> None:
    points = np.array([[0.0, 0.0], [639.0, 511.0]])
    np.testing.assert_array_equal(undistort_points(CAMERA, points), points)


def test_distortion_is_filled_up_to_a_length_opencv_takes() -> None:
    assert len(distortion_coefficients(replace(CAMERA, distortion=(0.1,) * 6))) == 8
    with pytest.raises(ValueError, match="14"):
        distortion_coefficients(replace(CAMERA, distortion=(0.1,) * 15))
