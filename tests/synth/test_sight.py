"""Where pixels look, against explicit projection by OpenCV: mount, relief and lens together."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.geometry.camera import camera_matrix, distortion_coefficients
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.rotation import rotation_ned_from_body
from uasthn_cli.synth.aircraft_errors import AircraftErrors
from uasthn_cli.synth.exposures import Exposure, camera_of, mounted, plan_exposures
from uasthn_cli.synth.flight import frame_image, ground_of
from uasthn_cli.synth.flight_config import FlightConfig
from uasthn_cli.synth.relief import DEM_GSD_M, Relief, draw_relief
from uasthn_cli.synth.sight import Sight
from uasthn_cli.types import Attitude, CameraModel, FloatArray

ERRORS = AircraftErrors(
    mount_roll_deg=3.0, mount_pitch_deg=-5.0, mount_yaw_deg=20.0, relief_m=50.0, lens_k1=-0.12
)
CONFIG = FlightConfig(
    frames=6, frame_width_px=160, frame_height_px=120, height_m=200.0, errors=ERRORS
)
MOUNT_FROM_OPTICAL = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
angles_deg = st.floats(-8.0, 8.0)


def hills(config: FlightConfig = CONFIG) -> Relief:
    _, exposures = plan_exposures(config)
    ground = ground_of(config, exposures)
    return draw_relief(np.random.default_rng(4), ground, config.errors.relief_m)


def projected_px(
    camera: CameraModel, vehicle: Attitude, errors: AircraftErrors, from_camera_ned_m: FloatArray
) -> FloatArray:
    """Project points ``(n, 3)``, north-east-down of the camera, with the convention spelled out."""
    mount = Attitude(
        *np.radians([errors.mount_roll_deg, errors.mount_pitch_deg, errors.mount_yaw_deg])
    )
    ned_from_optical = (
        rotation_ned_from_body(vehicle) @ rotation_ned_from_body(mount) @ MOUNT_FROM_OPTICAL
    )
    turn, _ = cv2.Rodrigues(ned_from_optical.T)
    points, _ = cv2.projectPoints(
        from_camera_ned_m,
        turn,
        np.zeros(3),
        camera_matrix(camera),
        distortion_coefficients(camera),
    )
    return np.asarray(points[:, 0], dtype=np.float64)


@settings(max_examples=25, deadline=None)
@given(
    roll_deg=angles_deg,
    pitch_deg=angles_deg,
    yaw_deg=st.floats(-180.0, 180.0),
    k1=st.floats(-0.3, 0.2),
    relief_m=st.sampled_from([0.0, 60.0]),
    index=st.integers(0, 5),
)
def test_convention_pixels_look_at_ground_that_projects_back_to_them(
    roll_deg: float, pitch_deg: float, yaw_deg: float, k1: float, relief_m: float, index: int
) -> None:
    errors = AircraftErrors(
        mount_roll_deg=roll_deg,
        mount_pitch_deg=pitch_deg,
        mount_yaw_deg=yaw_deg,
        relief_m=relief_m,
        lens_k1=k1,
    )
    config = replace(CONFIG, errors=errors)
    trajectory, exposures = plan_exposures(config)
    exposure = exposures[index]
    relief = hills(config) if relief_m else None
    camera = camera_of(config)
    points_px = np.random.default_rng(index).uniform((0, 0), (159, 119), (40, 2))
    points_px = np.concatenate([points_px, image_corners_px(160, 120)])
    seen_m = Sight(camera, relief).seen_m(exposure, points_px)
    ground_m = np.zeros(len(seen_m)) if relief is None else relief.at(seen_m)
    vehicle = trajectory.at(exposure.time_utc_s - config.start_utc_s)
    ned_m = np.stack(
        [
            seen_m[:, 1] - vehicle.north_m,
            seen_m[:, 0] - vehicle.east_m,
            vehicle.height_m - ground_m,
        ],
        axis=1,
    )
    assert projected_px(camera, vehicle.attitude, errors, ned_m) == pytest.approx(
        points_px, abs=0.01
    )


def test_convention_a_small_mount_adds_to_the_vehicle() -> None:
    vehicle = Attitude(0.02, -0.01, 2.0)
    camera = mounted(vehicle, AircraftErrors(mount_roll_deg=0.5, mount_pitch_deg=-1.0))
    assert camera.roll_rad == pytest.approx(0.02 + math.radians(0.5), abs=3e-4)
    assert camera.pitch_rad == pytest.approx(-0.01 - math.radians(1.0), abs=3e-4)
    assert camera.yaw_rad == pytest.approx(2.0, abs=6e-4)
    turned = mounted(vehicle, AircraftErrors(mount_yaw_deg=30.0))
    assert turned.yaw_rad == pytest.approx(2.0 + math.radians(30.0), abs=2e-3)
    assert mounted(vehicle, AircraftErrors()) == vehicle


@pytest.mark.parametrize("errors", [ERRORS, replace(ERRORS, relief_m=0.0)])
def test_a_warm_spot_appears_at_the_pixel_that_looks_at_it(errors: AircraftErrors) -> None:
    config = replace(CONFIG, errors=errors)
    _, exposures = plan_exposures(config)
    ground = ground_of(config, exposures)
    relief = draw_relief(np.random.default_rng(4), ground, 50.0) if errors.relief_m else None
    sight = Sight(camera_of(config), relief)
    x, y = np.meshgrid(np.arange(float(ground.width_px)), np.arange(float(ground.height_px)))
    for spot_px in ((12.0, 9.0), (150.0, 104.0), (80.0, 60.0)):
        spot_m = sight.seen_m(exposures[2], np.array([spot_px]))
        column, row = transform_points(ground.homography_ground_grid(), spot_m)[0]
        spread = np.exp(-0.5 * ((x - column) ** 2 + (y - row) ** 2) / 3.0**2)
        warmth = np.asarray(spread, dtype=np.float32)
        seen = frame_image(warmth, ground, exposures[2], (160, 120), sight)
        weights = np.where(seen > 0.3, seen, 0.0)
        ys, xs = np.mgrid[0:120, 0:160]
        centroid = (weights * xs).sum() / weights.sum(), (weights * ys).sum() / weights.sum()
        assert centroid == pytest.approx(spot_px, abs=0.15)


def test_flat_ground_by_remap_is_what_the_homography_shows() -> None:
    config = replace(CONFIG, errors=AircraftErrors())
    _, exposures = plan_exposures(config)
    ground = ground_of(config, exposures)
    field = np.random.default_rng(1).standard_normal((ground.height_px, ground.width_px))
    temperature = np.asarray(cv2.GaussianBlur(field, (0, 0), 3.0), dtype=np.float32)
    level = Relief(ground.west_m, ground.north_m, np.zeros((4, 4)))
    plain, followed = (
        frame_image(temperature, ground, exposures[1], (160, 120), Sight(camera_of(config), below))
        for below in (None, level)
    )
    assert np.abs(plain - followed).max() < 0.03 * plain.std()


def test_higher_ground_is_seen_closer_to_the_point_below() -> None:
    _, exposures = plan_exposures(replace(CONFIG, errors=AircraftErrors()))
    exposure: Exposure = exposures[0]
    camera = camera_of(replace(CONFIG, errors=AircraftErrors()))
    plateau = Relief(-1e4, 1e4, np.full((4, 4), 50.0))
    below_m = np.array([exposure.pose.east_m, exposure.pose.north_m])
    corners = image_corners_px(160, 120)
    low = Sight(camera, None).seen_m(exposure, corners) - below_m
    high = Sight(camera, plateau).seen_m(exposure, corners) - below_m
    assert high == pytest.approx(low * (1.0 - 50.0 / exposure.pose.height_m), abs=1e-6)


def test_rays_flatter_than_slopes_are_refused() -> None:
    config = replace(CONFIG, errors=AircraftErrors(mount_pitch_deg=30.0), hfov_deg=70.0)
    _, exposures = plan_exposures(config)
    cliffs = np.where(np.arange(400) % 2 == 0, 60.0, -60.0) * np.ones((400, 1))
    relief = Relief(-200.0 * DEM_GSD_M, 200.0 * DEM_GSD_M, cliffs)
    with pytest.raises(SyntheticFlightError, match="less relief"):
        Sight(camera_of(config), relief).frame_seen_m(exposures[0])


@pytest.mark.parametrize(
    ("errors", "hfov_deg"),
    [
        (AircraftErrors(mount_roll_deg=30.0, mount_pitch_deg=30.0), 120.0),
        (AircraftErrors(mount_roll_deg=-26.0, mount_pitch_deg=26.0, lens_k1=-0.1), 84.0),
    ],
)
def test_a_camera_that_sees_the_horizon_is_refused(errors: AircraftErrors, hfov_deg: float) -> None:
    config = replace(CONFIG, errors=errors, hfov_deg=hfov_deg)
    said = "lens sees the horizon" if errors.lens_k1 else "above the horizon: tilt"
    with pytest.raises(SyntheticFlightError, match=said):
        ground_of(config, plan_exposures(config)[1])
