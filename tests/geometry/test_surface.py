"""Rays meet the surface where it is: there and back, flat ground as before, relief as rendered."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.geometry.camera import HorizonError, homography_frame_ground
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.surface import CameraOverSurface, FlatGround, Relief, Surface
from uasthn_cli.types import Attitude, CameraModel, FloatArray

CAMERA = CameraModel(320, 256, 380.0, 390.0, 158.0, 129.0, mount_yaw_rad=0.4)
POSITION_M = np.array([130.0, -70.0])

angles = st.floats(-0.2, 0.2)
attitudes = st.builds(Attitude, angles, angles, st.floats(-3.1, 3.1))
frame_points = st.lists(
    st.tuples(st.floats(0.0, 319.0), st.floats(0.0, 255.0)), min_size=1, max_size=8
).map(np.array)


def hills(amplitude_m: float, phase: float) -> Relief:
    """Return hills 300 m apart on a grid of 10 m around the camera."""
    metres = np.arange(-600.0, 601.0, 10.0)
    east, north = np.meshgrid(metres, -metres)
    waves = np.sin(2 * math.pi * east / 300 + phase) * np.cos(2 * math.pi * north / 340)
    return Relief(amplitude_m * waves + 80.0, -600.0, 600.0, 10.0)


def camera_over(surface: Surface, attitude: Attitude, plane_m: float = 80.0) -> CameraOverSurface:
    return CameraOverSurface(CAMERA, attitude, POSITION_M, 330.0, surface, plane_m)


@given(attitudes, frame_points)
def test_over_flat_ground_it_is_the_homography(attitude: Attitude, points_px: FloatArray) -> None:
    over = camera_over(FlatGround(80.0), attitude)
    expected_m = transform_points(homography_frame_ground(CAMERA, attitude, 250.0), points_px)
    assert np.abs(over.to_ground(points_px) - POSITION_M - expected_m).max() < 1e-6
    assert np.abs(over.to_frame(expected_m + POSITION_M) - points_px).max() < 1e-6


@given(attitudes, frame_points, st.floats(0.0, 25.0), st.floats(0.0, 6.3))
def test_there_and_back_over_gentle_relief(
    attitude: Attitude, points_px: FloatArray, amplitude_m: float, phase: float
) -> None:
    over = camera_over(hills(amplitude_m, phase), attitude)
    assert np.abs(over.to_frame(over.to_ground(points_px)) - points_px).max() < 1e-3


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), frame_points)
def test_a_ray_meets_a_slope_where_geometry_says(
    slope_east: float, slope_north: float, points_px: FloatArray
) -> None:
    metres = np.arange(-900.0, 901.0, 100.0)
    east, north = np.meshgrid(metres, -metres)
    slope = Relief(80.0 + slope_east * east + slope_north * north, -900.0, 900.0, 100.0)
    over = camera_over(slope, Attitude(0.1, -0.05, 0.7))
    # one metre below the camera, a ray is this far from the point below it
    per_metre = camera_over(FlatGround(329.0), over.attitude).to_ground(points_px) - POSITION_M
    rise = np.array([slope_east, slope_north])
    down_m = (330.0 - 80.0 - POSITION_M @ rise) / (1.0 + per_metre @ rise)
    expected_m = POSITION_M + per_metre * down_m[:, None]
    assert np.abs(over.to_ground(points_px) - expected_m).max() < 1e-3


def test_ground_that_rises_is_nearer_and_so_is_what_a_frame_shows_of_it() -> None:
    corners_px = image_corners_px(320, 256)
    nadir = Attitude(0.0, 0.0, 0.0)
    low = camera_over(FlatGround(80.0), nadir).to_ground(corners_px) - POSITION_M
    high = camera_over(FlatGround(205.0), nadir).to_ground(corners_px) - POSITION_M
    assert high == pytest.approx(low / 2)


def test_heights_are_bilinear_and_unknown_beyond_the_grid_and_beside_a_hole() -> None:
    values_m = np.array([[1.0, 2.0, 3.0], [5.0, 6.0, 7.0], [9.0, 10.0, np.nan]])
    relief = Relief(values_m, 100.0, 50.0, 10.0)
    places_m = np.array([[100.0, 50.0], [105.0, 45.0], [120.0, 40.0], [115.0, 38.0], [99.0, 50.0]])
    expected_m = [1.0, 3.5, 7.0, math.nan, math.nan]
    # a point on the edge of the hole's cell has no height either
    expected_m[2] = relief.heights_m(places_m)[2]
    assert relief.heights_m(places_m) == pytest.approx(expected_m, nan_ok=True)
    assert relief.heights_m(places_m.reshape(5, 1, 2)).shape == (5, 1)


def test_where_nothing_is_known_ground_is_flat() -> None:
    nothing = Relief(np.full((3, 3), np.nan), -10.0, 10.0, 10.0)
    corners_px = image_corners_px(320, 256)
    attitude = Attitude(0.1, 0.05, 1.0)
    flat_m = camera_over(FlatGround(95.0), attitude).to_ground(corners_px)
    assert camera_over(nothing, attitude, plane_m=95.0).to_ground(corners_px) == pytest.approx(
        flat_m
    )


def test_what_is_above_the_camera_is_not_seen() -> None:
    over = camera_over(FlatGround(400.0), Attitude(0.0, 0.0, 0.0))
    assert np.isnan(over.to_frame(POSITION_M[None])).all()


def test_a_frame_that_sees_the_horizon_is_refused() -> None:
    over = camera_over(FlatGround(0.0), Attitude(1.3, 0.0, 0.0))
    with pytest.raises(HorizonError):
        over.to_ground(image_corners_px(320, 256))
