"""Where the frames of a flight are taken: the flown route, and each frame's true pose."""

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.geometry.camera import (
    HorizonError,
    focal_from_hfov_px,
    homography_frame_ground,
)
from uasthn_cli.geometry.rotation import attitude_from_rotation, rotation_ned_from_body
from uasthn_cli.synth.aircraft_errors import AircraftErrors
from uasthn_cli.synth.flight_config import FlightConfig
from uasthn_cli.synth.kinds import Route
from uasthn_cli.synth.trajectory import (
    Aircraft,
    Pose,
    Trajectory,
    exposure_times_s,
    fly,
    free_track,
    survey_track,
)
from uasthn_cli.types import Attitude, CameraModel, FloatArray

_LOG_TAIL_S = 3.0


class Stream(IntEnum):
    """Streams of random numbers, so that one choice does not reshuffle the others."""

    TRACK = 1
    WIND = 2
    AIR = 3
    GPS = 4
    LOG = 5
    CAMERA = 6
    ATTITUDE = 7
    RELIEF = 8
    LOST_FRAMES = 9
    LOST_MESSAGES = 10


@dataclass(frozen=True, slots=True)
class Exposure:
    """One frame's name, UTC time and true pose of the camera.

    ``H_frame_ground`` maps undistorted frame pixels to local metres on the mean ground.
    """

    name: str
    time_utc_s: float
    pose: Pose
    H_frame_ground: FloatArray


def camera_of(config: FlightConfig) -> CameraModel:
    """Return the flight's camera as its log knows it, image top to the nose."""
    focal_px = focal_from_hfov_px(config.frame_width_px, config.hfov_deg)
    return CameraModel(
        width_px=config.frame_width_px,
        height_px=config.frame_height_px,
        focal_x_px=focal_px,
        focal_y_px=focal_px,
        principal_x_px=(config.frame_width_px - 1) / 2.0,
        principal_y_px=(config.frame_height_px - 1) / 2.0,
        distortion=(config.errors.lens_k1,) if config.errors.lens_k1 else (),
    )


def plan_exposures(config: FlightConfig) -> tuple[Trajectory, list[Exposure]]:
    """Fly the route; return the true motion until just after the last exposure, and exposures.

    Raises:
        SyntheticFlightError: the aircraft never flies level for long enough, or the camera is
            mounted so that it sees the horizon.
    """
    spacing_m = (1.0 - config.overlap) * config.footprint_m[1]
    aircraft = Aircraft(
        config.airspeed_m_s,
        config.wind_m_s,
        float(random_stream(config, Stream.WIND).uniform(0.0, 2.0 * math.pi)),
        config.height_m,
    )
    track_m = _ground_track(config, spacing_m)
    trajectory = fly(random_stream(config, Stream.AIR), track_m, aircraft)
    tilt_rad = math.radians(config.largest_tilt_deg)
    times_s = exposure_times_s(trajectory, spacing_m, tilt_rad)[: config.frames]
    if len(times_s) < config.frames:
        raise SyntheticFlightError(
            f"only {len(times_s)} of {config.frames} exposures are level enough; allow more tilt"
        )
    exposures = [_exposure(config, trajectory, float(time_s)) for time_s in times_s]
    return trajectory.until(float(times_s[-1]) + _LOG_TAIL_S), exposures


def mounted(vehicle: Attitude, errors: AircraftErrors) -> Attitude:
    """Return the attitude of a camera whose mount is turned against the vehicle."""
    if not errors.turns_camera:
        return vehicle
    mount = Attitude(
        math.radians(errors.mount_roll_deg),
        math.radians(errors.mount_pitch_deg),
        math.radians(errors.mount_yaw_deg),
    )
    return attitude_from_rotation(rotation_ned_from_body(vehicle) @ rotation_ned_from_body(mount))


def random_stream(config: FlightConfig, *key: int) -> np.random.Generator:
    """Return the random numbers of one purpose."""
    return np.random.default_rng((config.seed, *key))


def _ground_track(config: FlightConfig, spacing_m: float) -> FloatArray:
    """Return the ground track ``(n, 2)``: lanes that make a square, or a free track."""
    rng = random_stream(config, Stream.TRACK)
    heading_rad = float(rng.uniform(0.0, 2.0 * math.pi))
    if config.route is Route.TRACK:
        return free_track(rng, 200.0 + 2.0 * config.frames * spacing_m, heading_rad)
    lane_spacing_m = max((1.0 - config.overlap) * config.footprint_m[0], 20.0)
    lanes = max(1, round(math.sqrt(config.frames * spacing_m / lane_spacing_m)))
    lane_m = math.ceil(config.frames / lanes) * spacing_m + 0.05 * lane_spacing_m
    return survey_track(lane_m, lanes + 3, lane_spacing_m, heading_rad)


def _exposure(config: FlightConfig, trajectory: Trajectory, time_s: float) -> Exposure:
    """Return the exposure at a time of the flight."""
    vehicle = trajectory.at(time_s)
    pose = replace(vehicle, attitude=mounted(vehicle.attitude, config.errors))
    time_utc_s = round(config.start_utc_s + time_s, 3)
    below = np.array([[1.0, 0.0, pose.east_m], [0.0, 1.0, pose.north_m], [0.0, 0.0, 1.0]])
    try:
        H = below @ homography_frame_ground(camera_of(config), pose.attitude, pose.height_m)
    except HorizonError as error:
        raise SyntheticFlightError(f"{error}: tilt the camera's mount less") from error
    stamped_s = time_utc_s - config.errors.clock_late_s
    return Exposure(f"frame_{round(stamped_s * 1000)}.png", time_utc_s, pose, H)
