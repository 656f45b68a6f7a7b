"""How the aircraft flies and what its GPS/INS believes.

A route is a ground track of straights and arcs. The aircraft holds airspeed and height, crabs into
the wind, banks in turns, and sways a little; the GPS/INS sees all of that through a position error
that drifts over minutes, a yaw bias and a height bias.
"""

import math
from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from uasthn_cli.types import Attitude, FloatArray

SAMPLE_INTERVAL_S = 0.05
_GRAVITY_M_S2 = 9.81
_STEP_M = 1.0
_LARGEST_BANK_RAD = math.radians(35.0)


@dataclass(frozen=True, slots=True)
class Aircraft:
    """Airspeed, wind (blowing towards ``wind_to_rad``, clockwise from north) and height kept."""

    airspeed_m_s: float
    wind_m_s: float
    wind_to_rad: float
    height_m: float


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the camera is: metres east and north of the origin, height over the mean ground."""

    east_m: float
    north_m: float
    height_m: float
    attitude: Attitude


@dataclass(frozen=True, slots=True)
class Trajectory:
    """True motion sampled at times ``(n,)`` in seconds from take-off; yaw is unwrapped."""

    times_s: FloatArray
    east_m: FloatArray
    north_m: FloatArray
    height_m: FloatArray
    roll_rad: FloatArray
    pitch_rad: FloatArray
    yaw_rad: FloatArray

    def at(self, time_s: float) -> Pose:
        """Return the pose at a time, linear between samples."""
        east, north, height, roll, pitch, yaw = (
            float(np.interp(time_s, self.times_s, values))
            for values in (
                self.east_m,
                self.north_m,
                self.height_m,
                self.roll_rad,
                self.pitch_rad,
                self.yaw_rad,
            )
        )
        return Pose(east, north, height, Attitude(roll, pitch, yaw))

    def until(self, time_s: float) -> "Trajectory":
        """Return the part of the flight up to a time."""
        count = int(np.searchsorted(self.times_s, time_s, side="right"))
        return Trajectory(*(getattr(self, part.name)[:count] for part in fields(self)))


@dataclass(frozen=True, slots=True)
class NavigationError:
    """What the GPS/INS gets wrong: shifts in metres at the trajectory's times, and two biases.

    ``attitude_rad`` ``(3, n)`` is how far roll, pitch and yaw have drifted.
    """

    east_m: FloatArray
    north_m: FloatArray
    attitude_rad: FloatArray
    yaw_rad: float
    height_share: float


def survey_track(
    lane_m: float, lanes: int, lane_spacing_m: float, heading_rad: float
) -> FloatArray:
    """Return the ground track ``(n, 2)`` (east, north) of parallel lanes joined by half circles."""
    run_out_m = 30.0
    turn_m = math.pi * 0.5 * lane_spacing_m
    pieces = []
    for lane in range(lanes):
        pieces.append(np.zeros(math.ceil((lane_m + 2.0 * run_out_m) / _STEP_M)))
        side = 1.0 if lane % 2 == 0 else -1.0
        count = math.ceil(turn_m / _STEP_M)
        pieces.append(np.full(count, side * math.pi / (count * _STEP_M)))
    return _integrated(np.concatenate(pieces), heading_rad)


def free_track(rng: np.random.Generator, length_m: float, heading_rad: float) -> FloatArray:
    """Return a ground track ``(n, 2)`` of straights of 300 to 900 m and turns of up to 100°."""
    pieces: list[FloatArray] = []
    total_m = 0.0
    while total_m < length_m:
        straight_m = float(rng.uniform(300.0, 900.0))
        radius_m = float(rng.uniform(150.0, 400.0))
        turn_rad = float(rng.uniform(0.4, 1.8))
        side = 1.0 if rng.random() < 0.7 else -1.0
        pieces.append(np.zeros(math.ceil(straight_m / _STEP_M)))
        pieces.append(np.full(math.ceil(turn_rad * radius_m / _STEP_M), side / radius_m))
        total_m += straight_m + turn_rad * radius_m
    return _integrated(np.concatenate(pieces), heading_rad)


def fly(rng: np.random.Generator, track_m: FloatArray, aircraft: Aircraft) -> Trajectory:
    """Fly a ground track ``(n, 2)``: wind triangle for speed and crab, bank for turns, sway."""
    steps = np.diff(track_m, axis=0)
    course = np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))
    wind_along = aircraft.wind_m_s * np.cos(aircraft.wind_to_rad - course)
    wind_right = aircraft.wind_m_s * np.sin(aircraft.wind_to_rad - course)
    speed = wind_along + np.sqrt(aircraft.airspeed_m_s**2 - wind_right**2)
    passed_s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1) / speed)])
    times_s = np.arange(0.0, passed_s[-1], SAMPLE_INTERVAL_S)
    yaw = np.interp(times_s, passed_s[1:], course - np.arcsin(wind_right / aircraft.airspeed_m_s))
    yaw = gaussian_filter1d(yaw, 0.8 / SAMPLE_INTERVAL_S, mode="nearest")
    turn_rate = np.gradient(yaw, SAMPLE_INTERVAL_S)
    bank = np.arctan(aircraft.airspeed_m_s * turn_rate / _GRAVITY_M_S2)
    count = len(times_s)
    return Trajectory(
        times_s=times_s,
        east_m=np.interp(times_s, passed_s, track_m[:, 0]),
        north_m=np.interp(times_s, passed_s, track_m[:, 1]),
        height_m=aircraft.height_m * (1.0 + 0.01 * wandering(rng, count, 40.0)),
        roll_rad=np.clip(bank, -_LARGEST_BANK_RAD, _LARGEST_BANK_RAD)
        + math.radians(1.1) * wandering(rng, count, 2.5),
        pitch_rad=math.radians(rng.normal(1.0, 0.5))
        + math.radians(0.9) * wandering(rng, count, 3.0),
        yaw_rad=yaw + math.radians(0.8) * wandering(rng, count, 4.0),
    )


def exposure_times_s(
    trajectory: Trajectory, spacing_m: float, largest_tilt_rad: float
) -> FloatArray:
    """Return exposure times ``(n,)``, whole milliseconds, every ``spacing_m`` of flown ground.

    A camera on a survey is held in turns: exposures tilted by more than ``largest_tilt_rad`` are
    left out.
    """
    moved_m = np.hypot(np.diff(trajectory.east_m), np.diff(trajectory.north_m))
    passed_m = np.concatenate([[0.0], np.cumsum(moved_m)])
    marks_m = np.arange(30.0, passed_m[-1] - 30.0, spacing_m)
    times_s = np.round(np.interp(marks_m, passed_m, trajectory.times_s), 3)
    tilts = np.arccos(np.cos(trajectory.roll_rad) * np.cos(trajectory.pitch_rad))
    kept: FloatArray = times_s[np.interp(times_s, trajectory.times_s, tilts) <= largest_tilt_rad]
    return kept


def navigation_error(
    rng: np.random.Generator,
    count: int,
    *,
    drift_m: float,
    yaw_bias_rad: float,
    height_bias: float,
    attitude_rad: FloatArray | None = None,
) -> NavigationError:
    """Draw what the GPS/INS gets wrong on a flight of ``count`` samples.

    The position drifts as an Ornstein-Uhlenbeck process with a memory of three minutes, its
    largest excursion being ``drift_m``; the biases are between half and all of those given, either
    way. The drift ``(3, count)`` of the attitude is taken as given; None is no drift.
    """
    drift = np.stack([wandering(rng, count, 180.0) for _ in range(2)])
    farthest = float(np.linalg.norm(drift, axis=0).max())
    drift *= drift_m / (farthest + 1e-9)
    signs = rng.choice([-1.0, 1.0], 2) * rng.uniform(0.5, 1.0, 2)
    return NavigationError(
        east_m=drift[0],
        north_m=drift[1],
        attitude_rad=np.zeros((3, count)) if attitude_rad is None else attitude_rad,
        yaw_rad=float(signs[0]) * yaw_bias_rad,
        height_share=float(signs[1]) * height_bias,
    )


def attitude_drift(rng: np.random.Generator, count: int, largest_rad: float) -> FloatArray:
    """Draw how far roll, pitch and yaw ``(3, count)`` drift: memory of a minute, largest as given.

    Each of the three reaches ``largest_rad`` once, to one side or the other.
    """
    drift = np.stack([wandering(rng, count, 60.0) for _ in range(3)])
    farthest = np.abs(drift).max(axis=1, keepdims=True)
    scaled: FloatArray = drift * (largest_rad / (farthest + 1e-9))
    return scaled


def wandering(rng: np.random.Generator, count: int, memory_s: float) -> FloatArray:
    """Return an Ornstein-Uhlenbeck process ``(count,)`` of unit deviation, clipped at 2.2.

    Exact discretisation at the sample interval, then smoothed over half a second as a body with
    inertia would be.
    """
    decay = math.exp(-SAMPLE_INTERVAL_S / memory_s)
    kicks = math.sqrt(1.0 - decay**2) * rng.standard_normal(count)
    kicks[0] = rng.standard_normal()
    values = lfilter([1.0], [1.0, -decay], kicks)
    smoothed = gaussian_filter1d(values, 0.5 / SAMPLE_INTERVAL_S, mode="nearest")
    return np.asarray(np.clip(smoothed, -2.2, 2.2), dtype=np.float64)


def _integrated(curvature_per_m: FloatArray, heading_rad: float) -> FloatArray:
    """Return the track ``(n + 1, 2)`` (east, north) of a curvature sampled each step."""
    headings = heading_rad + np.cumsum(curvature_per_m) * _STEP_M
    steps = _STEP_M * np.stack([np.sin(headings), np.cos(headings)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
