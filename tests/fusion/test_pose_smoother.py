"""Errors of position, mount, attitude and clock are told apart, with honest deviations."""

import math
from dataclasses import replace

import numpy as np
import pytest

from uasthn_cli.fusion.pose_smoother import (
    PoseDeviations,
    PoseObservations,
    expected_deviations,
    smooth_poses,
)
from uasthn_cli.types import FloatArray

HEIGHT_M = 250.0
SPEED_M_S = 18.0
FRAME_S = 6.0
EXPECTED = PoseDeviations(math.radians(1.5), math.radians(0.3), 0.5)


def flight(
    seed: int,
    mount_rad: tuple[float, float],
    clock_s: float,
    *,
    lanes: int = 5,
    frames_a_lane: int = 10,
    drift_m: float = 1.0,
) -> tuple[PoseObservations, FloatArray]:
    """Return observations of a flight in lanes, and the true tilts ``(T, 2)``.

    The position drifts at random by ``drift_m`` per root second, frames are found to 1.5 m.
    """
    rng = np.random.default_rng(seed)
    count = lanes * frames_a_lane
    heading = np.pi * ((np.arange(count) // frames_a_lane) % 2) + 0.3
    ahead = np.stack([np.sin(heading), np.cos(heading)], axis=1)
    left = np.stack([-np.cos(heading), np.sin(heading)], axis=1)
    per_tilt_m = HEIGHT_M * np.stack([left, ahead], axis=2)
    per_second_m = SPEED_M_S * ahead + rng.normal(0.0, 3.0, (count, 2))
    tilt = wandering_tilt(rng, count) + mount_rad
    steps_m = rng.normal(0.0, drift_m * math.sqrt(FRAME_S), (count, 2))
    drift = steps_m.cumsum(axis=0) + np.array([80.0, -30.0])
    moved = (per_tilt_m @ tilt[..., None])[..., 0] + clock_s * per_second_m
    seen = PoseObservations(
        times_s=FRAME_S * np.arange(float(count)),
        offsets_m=drift + moved + rng.normal(0.0, 1.5, (count, 2)),
        covariances_m2=np.tile(1.5**2 * np.eye(2), (count, 1, 1)),
        per_tilt_m=per_tilt_m,
        per_second_m=per_second_m,
        tilts_rad=np.full((count, 2), np.nan),
        tilt_covariances_rad2=np.zeros((count, 2, 2)),
    )
    return seen, tilt


def wandering_tilt(rng: np.random.Generator, count: int) -> FloatArray:
    """Return an attitude's error ``(count, 2)`` that wanders over a minute."""
    decay = math.exp(-FRAME_S / 60.0)
    tilt = rng.normal(0.0, EXPECTED.wander_rad, (count, 2))
    for index in range(1, count):
        tilt[index] = decay * tilt[index - 1] + math.sqrt(1 - decay**2) * tilt[index]
    return tilt


def test_mount_and_clock_are_told_apart_over_lanes_flown_both_ways() -> None:
    mount_rad = (math.radians(1.5), math.radians(-2.5))
    seen, tilt = flight(1, mount_rad, 0.4)
    found = smooth_poses(seen, EXPECTED)
    for constant, true in zip(
        (found.mount_roll_rad, found.mount_pitch_rad, found.clock_s),
        (*mount_rad, 0.4),
        strict=True,
    ):
        assert abs(constant.value - true) < 3.0 * constant.error
        assert constant.count == len(seen.times_s)
    assert found.mount_pitch_rad.is_significant
    before, after = np.sqrt((tilt**2).mean()), np.sqrt(((found.tilt_rad - tilt) ** 2).mean())
    assert after < 0.4 * before


def test_deviations_hold_over_many_flights() -> None:
    """Mounts and clocks are drawn as expected: errors are as large as they are said to be."""
    rng = np.random.default_rng(3)
    scaled = []
    for seed in range(60):
        mount = rng.normal(0.0, EXPECTED.mount_rad, 2)
        clock_s = float(rng.normal(0.0, EXPECTED.clock_s))
        seen, tilt = flight(seed, (float(mount[0]), float(mount[1])), clock_s, lanes=3)
        found = smooth_poses(seen, EXPECTED)
        deviations = np.sqrt(np.diagonal(found.tilt_covariances_rad2, axis1=1, axis2=2))
        scaled.append((found.tilt_rad - tilt) / deviations)
    assert np.sqrt((np.concatenate(scaled) ** 2).mean()) == pytest.approx(1.0, abs=0.2)


def test_one_straight_leg_leaves_the_mount_as_uncertain_as_expected() -> None:
    seen, _ = flight(2, (0.0, math.radians(2.0)), 0.0, lanes=1, frames_a_lane=30, drift_m=4.0)
    found = smooth_poses(seen, EXPECTED)
    assert found.mount_pitch_rad.error > 0.9 * EXPECTED.mount_rad
    assert not found.mount_pitch_rad.is_significant


def test_perspective_tells_the_mount_where_lanes_do_not() -> None:
    true_rad = math.radians(2.0)
    seen, tilt = flight(2, (0.0, true_rad), 0.0, lanes=1, frames_a_lane=30, drift_m=4.0)
    rng = np.random.default_rng(5)
    deviation_rad = math.radians(1.5)
    noisy = tilt + rng.normal(0, deviation_rad, (30, 2))
    seen = replace(
        seen,
        tilts_rad=np.where(np.arange(30)[:, None] % 2, np.nan, noisy),
        tilt_covariances_rad2=np.tile(deviation_rad**2 * np.eye(2), (30, 1, 1)),
    )
    found = smooth_poses(seen, EXPECTED)
    assert found.frames_with_perspective == 15
    assert found.mount_pitch_rad.error < 0.4 * EXPECTED.mount_rad
    assert abs(found.mount_pitch_rad.value - true_rad) < 3.0 * found.mount_pitch_rad.error


def test_frames_found_far_off_and_silent_ones_cost_little() -> None:
    seen, tilt = flight(4, (math.radians(-1.0), math.radians(1.0)), 0.0)
    offsets_m = seen.offsets_m.copy()
    offsets_m[::9] += [12.0, -9.0]
    offsets_m[4::9] = np.nan
    found = smooth_poses(replace(seen, offsets_m=offsets_m), EXPECTED)
    assert found.mount_roll_rad.count == int(np.isfinite(offsets_m[:, 0]).sum())
    assert np.isfinite(found.tilt_rad).all()
    assert np.sqrt(((found.tilt_rad - tilt) ** 2).mean()) < math.radians(1.0)


def test_a_surer_attitude_is_corrected_less() -> None:
    seen, _ = flight(6, (0.0, math.radians(1.0)), 0.0, lanes=2)
    surer, loose = (
        smooth_poses(seen, expected_deviations(math.radians(deg))) for deg in (0.1, 2.0)
    )
    assert np.abs(surer.tilt_rad).max() < np.abs(loose.tilt_rad).max()
    assert surer.tilt_covariances_rad2.max() < loose.tilt_covariances_rad2.max()
