"""Flight mechanics: wind triangle, banks, exposures; what the GPS/INS gets wrong."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uasthn_cli.synth.trajectory import (
    SAMPLE_INTERVAL_S,
    Aircraft,
    exposure_times_s,
    fly,
    free_track,
    navigation_error,
    survey_track,
    wandering,
)
from uasthn_cli.types import FloatArray


def straight_track(heading_rad: float, length_m: float = 900.0) -> FloatArray:
    along = np.arange(0.0, length_m)
    return np.stack([along * math.sin(heading_rad), along * math.cos(heading_rad)], axis=1)


@settings(max_examples=25, deadline=None)
@given(
    heading_rad=st.floats(0.0, 6.28),
    wind_m_s=st.floats(0.0, 9.0),
    wind_to_rad=st.floats(0.0, 6.28),
)
def test_wind_triangle_closes(heading_rad: float, wind_m_s: float, wind_to_rad: float) -> None:
    aircraft = Aircraft(18.0, wind_m_s, wind_to_rad, 300.0)
    flight = fly(np.random.default_rng(0), straight_track(heading_rad), aircraft)
    velocity = np.array(
        [
            np.gradient(flight.east_m, SAMPLE_INTERVAL_S)[100:-100].mean(),
            np.gradient(flight.north_m, SAMPLE_INTERVAL_S)[100:-100].mean(),
        ]
    )
    air = velocity - wind_m_s * np.array([math.sin(wind_to_rad), math.cos(wind_to_rad)])
    assert np.linalg.norm(air) == pytest.approx(18.0, rel=1e-3)
    yaw_rad = math.atan2(air[0], air[1])
    off_rad = float(flight.yaw_rad.mean()) - yaw_rad
    assert abs(math.remainder(off_rad, 2.0 * math.pi)) < math.radians(1.5)


def test_convention_a_right_turn_banks_right() -> None:
    track = survey_track(300.0, 2, 200.0, heading_rad=0.0)
    flight = fly(np.random.default_rng(0), track, Aircraft(18.0, 0.0, 0.0, 300.0))
    turning = np.gradient(flight.yaw_rad, SAMPLE_INTERVAL_S) > math.radians(6.0)
    assert turning.sum() > 50
    assert np.median(flight.roll_rad[turning]) > math.radians(10.0)
    assert flight.east_m[-1] > 150.0, "the second lane lies to the right of the first"


def test_survey_lanes_are_parallel_and_spaced() -> None:
    track = survey_track(400.0, 3, 120.0, heading_rad=0.0)
    middle = np.abs(track[:, 1] - 230.0) < 0.6
    lanes = np.unique(np.round(track[middle, 0]))
    assert lanes == pytest.approx([0.0, 120.0, 240.0], abs=2.0)


def test_free_track_is_long_enough_and_smooth() -> None:
    track = free_track(np.random.default_rng(2), 3000.0, 1.0)
    steps = np.diff(track, axis=0)
    assert np.linalg.norm(steps, axis=1).sum() >= 3000.0
    courses = np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))
    assert np.abs(np.diff(courses)).max() <= 1.0 / 150.0 + 1e-9


def test_exposures_are_spaced_and_level() -> None:
    track = survey_track(500.0, 3, 150.0, heading_rad=0.7)
    flight = fly(np.random.default_rng(3), track, Aircraft(18.0, 5.0, 2.0, 250.0))
    times_s = exposure_times_s(flight, 60.0, math.radians(4.0))
    assert len(times_s) > 15
    poses = [flight.at(float(time_s)) for time_s in times_s]
    for pose in poses:
        level = math.cos(pose.attitude.roll_rad) * math.cos(pose.attitude.pitch_rad)
        assert level >= math.cos(math.radians(4.01))
        assert pose.height_m == pytest.approx(250.0, rel=0.03)
    assert times_s == pytest.approx(np.round(times_s, 3), abs=1e-9)
    gaps_m = np.hypot(*np.diff([(pose.east_m, pose.north_m) for pose in poses], axis=0).T)
    assert np.median(gaps_m) == pytest.approx(60.0, rel=0.02)


def test_until_cuts_every_part() -> None:
    flight = fly(np.random.default_rng(0), straight_track(0.3), Aircraft(18.0, 0.0, 0.0, 100.0))
    part = flight.until(10.0)
    assert part.times_s[-1] == pytest.approx(10.0)
    assert len(part.yaw_rad) == len(part.height_m) == len(part.times_s)
    assert part.at(5.0) == flight.at(5.0)


def test_position_error_drifts_slowly_up_to_its_limit() -> None:
    error = navigation_error(
        np.random.default_rng(8), 12_000, drift_m=120.0, yaw_bias_rad=0.035, height_bias=0.03
    )
    radius_m = np.hypot(error.east_m, error.north_m)
    assert radius_m.max() == pytest.approx(120.0, rel=1e-6)
    second_m = np.hypot(np.diff(error.east_m[::20]), np.diff(error.north_m[::20]))
    assert np.percentile(second_m, 99) < 30.0
    assert 0.0174 < abs(error.yaw_rad) < 0.0351
    assert 0.0149 < abs(error.height_share) < 0.0301


def test_wandering_has_unit_deviation_and_memory() -> None:
    values = wandering(np.random.default_rng(1), 200_000, 5.0)
    assert values.std() == pytest.approx(0.93, abs=0.08)
    lag = round(5.0 / SAMPLE_INTERVAL_S)
    likeness = np.corrcoef(values[:-lag], values[lag:])[0, 1]
    assert likeness == pytest.approx(math.exp(-1.0), abs=0.12)
