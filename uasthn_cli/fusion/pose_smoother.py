"""A flight's errors of position, mount, attitude and clock, told apart by how they move frames.

Each frame was found a little beside where the log has it. A drifting position moves it to the same
side whichever way the aircraft looks, a mount turned in roll or pitch moves it with the heading, a
late clock along the path of the frame's centre; perspective within a frame shows its tilt. All are
one linear state with Gaussian noise, which a Kalman filter and a Rauch-Tung-Striebel smoother tell
apart (Särkkä, Bayesian Filtering and Smoothing, 2013, algorithms 4.1 and 8.1).
"""

import math
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from uasthn_cli.fusion.constants import Constant
from uasthn_cli.types import FloatArray

_STATES: Final = 9
_PLACE, _RATE, _MOUNT, _WANDER = slice(0, 2), slice(2, 4), slice(4, 6), slice(6, 8)
_CLOCK: Final = 8
_OFFSET, _TILT = slice(0, 2), slice(2, 4)
"""The state: position's error and its rate (east, north), mount and attitude (roll, pitch), clock.
A frame is known by the offset of its centre and by its tilt.
"""

_DRIFTS: Final = np.array(
    list(product((0.1, 0.3, 1.0, 2.0, 4.0, 8.0), (0.0, 0.02, 0.06, 0.2))), np.float64
)
"""How a position may drift: at random, in m/s^0.5, and with a rate that changes, in m/s^1.5."""

_START_M = 3000.0
_START_M_S = 3.0
_WANDER_MEMORY_S = 60.0
_STUDENT_DEGREES = 4.0
"""Frames' own places scatter by a Student distribution: a few are far off."""

_ROUNDS: Final = 2

_MOUNT_PER_ATTITUDE_ERROR: Final = 1.5
_WANDER_PER_ATTITUDE_ERROR: Final = 0.5
_CLOCK_ERROR_S: Final = 0.5
"""What is expected before a flight is seen; the first two per expected error of the attitude."""

_SILENT = 1e8
"""Variance of what says nothing."""


@dataclass(frozen=True, slots=True)
class PoseObservations:
    """Where T frames were found beside the log, and what would move them there.

    ``times_s`` ``(T,)`` in order; ``offsets_m`` ``(T, 2)`` (east, north), those of silent frames
    being NaN, with ``covariances_m2`` ``(T, 2, 2)``; ``per_tilt_m`` ``(T, 2, 2)`` metres by which a
    frame's centre moves, a column for a radian of roll and of pitch; ``per_second_m`` ``(T, 2)``
    metres by which it moves in a second of the log. ``tilts_rad`` ``(T, 2)`` is what perspective
    adds to roll and pitch, NaN where nobody looked, with ``tilt_covariances_rad2`` ``(T, 2, 2)``.
    """

    times_s: FloatArray
    offsets_m: FloatArray
    covariances_m2: FloatArray
    per_tilt_m: FloatArray
    per_second_m: FloatArray
    tilts_rad: FloatArray
    tilt_covariances_rad2: FloatArray


@dataclass(frozen=True, slots=True)
class PoseDeviations:
    """Standard deviations before a flight is seen: of the mount, of the attitude, of the clock."""

    mount_rad: float
    wander_rad: float
    clock_s: float


def expected_deviations(attitude_error_rad: float) -> PoseDeviations:
    """Return what is expected of a flight whose logged roll and pitch are as wrong as given."""
    return PoseDeviations(
        _MOUNT_PER_ATTITUDE_ERROR * attitude_error_rad,
        _WANDER_PER_ATTITUDE_ERROR * attitude_error_rad,
        _CLOCK_ERROR_S,
    )


@dataclass(frozen=True, slots=True)
class SmoothedPoses:
    """What the frames of a flight say together.

    ``tilt_rad`` ``(T, 2)`` is to be added to roll and pitch of each frame, mount and attitude
    together, with ``tilt_covariances_rad2`` ``(T, 2, 2)``. ``mount_roll_rad``,
    ``mount_pitch_rad`` and ``clock_s`` are constants of the flight. ``frames_with_perspective``
    showed their tilt themselves.
    """

    tilt_rad: FloatArray
    tilt_covariances_rad2: FloatArray
    mount_roll_rad: Constant
    mount_pitch_rad: Constant
    clock_s: Constant
    frames_with_perspective: int


@dataclass(frozen=True, slots=True)
class _Step:
    """One frame in the filter: predicted and updated mean ``(9,)`` and covariance ``(9, 9)``."""

    transition: FloatArray
    predicted: tuple[FloatArray, FloatArray]
    updated: tuple[FloatArray, FloatArray]


def smooth_poses(seen: PoseObservations, expected: PoseDeviations) -> SmoothedPoses:
    """Return what T frames say together; how the position drifts is the likeliest of a few ways."""
    found, noise = _measured(seen)
    design = _design(seen)
    log_evidence, _ = _filter(seen.times_s, found, noise, design, _DRIFTS, expected)
    drift = _DRIFTS[[int(log_evidence.argmax())]]
    own = noise[:, _OFFSET, _OFFSET].copy()
    for _ in range(_ROUNDS):
        means, covariances = _smooth(seen.times_s, found, noise, design, drift, expected)
        residual = (found - (design @ means[..., None])[..., 0])[:, _OFFSET]
        spread = (design @ covariances @ design.transpose(0, 2, 1))[:, _OFFSET, _OFFSET] + own
        distance2 = np.einsum("ti,tij,tj->t", residual, np.linalg.inv(spread), residual)
        weights = (_STUDENT_DEGREES + 2.0) / (_STUDENT_DEGREES + distance2)
        noise[:, _OFFSET, _OFFSET] = own / np.minimum(weights, 1.0)[:, None, None]
    means, covariances = _smooth(seen.times_s, found, noise, design, drift, expected)
    return _told_apart(seen, means, covariances)


def _measured(seen: PoseObservations) -> tuple[FloatArray, FloatArray]:
    """Return what is known of each frame ``(T, 4)``, offset and tilt, and its noise."""
    found = np.concatenate([seen.offsets_m, seen.tilts_rad], axis=1)
    noise = np.zeros((len(found), 4, 4))
    parts = ((_OFFSET, seen.covariances_m2), (_TILT, seen.tilt_covariances_rad2))
    for part, covariances in parts:
        speaks = np.isfinite(found[:, part]).all(axis=1)
        noise[:, part, part] = np.where(speaks[:, None, None], covariances, _SILENT * np.eye(2))
    return np.nan_to_num(found), noise


def _design(seen: PoseObservations) -> FloatArray:
    """Return ``(T, 4, 9)``: what each part of the state makes of a frame's offset and tilt."""
    design = np.zeros((len(seen.times_s), 4, _STATES))
    design[:, _OFFSET, _PLACE] = np.eye(2)
    design[:, _OFFSET, _MOUNT] = design[:, _OFFSET, _WANDER] = seen.per_tilt_m
    design[:, _OFFSET, _CLOCK] = seen.per_second_m
    design[:, _TILT, _MOUNT] = design[:, _TILT, _WANDER] = np.eye(2)
    return design


def _start(drifts: FloatArray, expected: PoseDeviations) -> FloatArray:
    """Return the covariances ``(H, 9, 9)`` before the first frame, under H ways to drift."""
    variances = np.zeros((len(drifts), _STATES))
    variances[:, _PLACE] = _START_M**2
    variances[:, _RATE] = np.where(drifts[:, 1:] > 0, _START_M_S**2, 0.0)
    variances[:, _MOUNT] = expected.mount_rad**2
    variances[:, _WANDER] = expected.wander_rad**2
    variances[:, _CLOCK] = expected.clock_s**2
    return np.asarray(variances[:, None] * np.eye(_STATES))


def _transition(
    step_s: float, drifts: FloatArray, wander_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Return the transition ``(9, 9)`` over a step of time and its noise ``(H, 9, 9)``."""
    transition, decay = np.eye(_STATES), math.exp(-step_s / _WANDER_MEMORY_S)
    transition[_PLACE, _RATE] = step_s * np.eye(2)
    transition[_WANDER, _WANDER] = decay * np.eye(2)
    noise = np.zeros((len(drifts), _STATES, _STATES))
    random2, rate2 = drifts[:, 0, None, None] ** 2, drifts[:, 1, None, None] ** 2
    noise[:, _PLACE, _PLACE] = (random2 * step_s + rate2 * step_s**3 / 3) * np.eye(2)
    noise[:, _PLACE, _RATE] = noise[:, _RATE, _PLACE] = rate2 * step_s**2 / 2 * np.eye(2)
    noise[:, _RATE, _RATE] = rate2 * step_s * np.eye(2)
    noise[:, _WANDER, _WANDER] = wander_rad**2 * (1.0 - decay**2) * np.eye(2)
    return transition, noise


def _filter(
    times_s: FloatArray,
    found: FloatArray,
    noise: FloatArray,
    design: FloatArray,
    drifts: FloatArray,
    expected: PoseDeviations,
) -> tuple[FloatArray, list[_Step]]:
    """Return the log evidence ``(H,)`` of H ways to drift, and the steps under the first."""
    mean, covariance = np.zeros((len(drifts), _STATES)), _start(drifts, expected)
    log_evidence, steps = np.zeros(len(drifts)), []
    for index, step_s in enumerate(np.diff(times_s, prepend=times_s[0]).tolist()):
        transition, added = _transition(step_s, drifts, expected.wander_rad)
        mean, covariance = mean @ transition.T, transition @ covariance @ transition.T + added
        predicted = mean[0], covariance[0]
        moved = covariance @ design[index].T
        spread = design[index] @ moved + noise[index]
        gain = moved @ np.linalg.inv(spread)
        residual = (found[index] - mean @ design[index].T)[..., None]
        distance2 = (residual * np.linalg.solve(spread, residual)).sum(axis=(1, 2))
        log_evidence -= 0.5 * (distance2 + np.log(np.linalg.det(spread)))
        mean = mean + (gain @ residual)[..., 0]
        covariance = covariance - gain @ moved.transpose(0, 2, 1)
        covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
        steps.append(_Step(transition, predicted, (mean[0], covariance[0])))
    return log_evidence, steps


def _smooth(
    times_s: FloatArray,
    found: FloatArray,
    noise: FloatArray,
    design: FloatArray,
    drift: FloatArray,
    expected: PoseDeviations,
) -> tuple[FloatArray, FloatArray]:
    """Return means ``(T, 9)`` and covariances ``(T, 9, 9)`` given all frames."""
    _, steps = _filter(times_s, found, noise, design, drift, expected)
    mean, covariance = steps[-1].updated
    means, covariances = [mean], [covariance]
    for step, following in zip(steps[-2::-1], steps[:0:-1], strict=True):
        own_mean, own_covariance = step.updated
        predicted_mean, predicted_covariance = following.predicted
        # a position that drifts at random alone has no rate: its rows are 0
        inverse = np.linalg.pinv(predicted_covariance, rcond=1e-14, hermitian=True)
        gain = own_covariance @ following.transition.T @ inverse
        mean = own_mean + gain @ (mean - predicted_mean)
        covariance = own_covariance + gain @ (covariance - predicted_covariance) @ gain.T
        means.append(mean)
        covariances.append((covariance + covariance.T) / 2)
    return np.array(means[::-1]), np.array(covariances[::-1])


def _told_apart(
    seen: PoseObservations, means: FloatArray, covariances: FloatArray
) -> SmoothedPoses:
    tilt = np.zeros((2, _STATES))
    tilt[:, _MOUNT] = tilt[:, _WANDER] = np.eye(2)
    placed, tilted = (
        int(np.isfinite(values).all(axis=1).sum()) for values in (seen.offsets_m, seen.tilts_rad)
    )
    roll, pitch, clock = (
        Constant(float(means[-1, k]), math.sqrt(max(float(covariances[-1, k, k]), 0.0)), placed)
        for k in (_MOUNT.start, _MOUNT.start + 1, _CLOCK)
    )
    return SmoothedPoses(means @ tilt.T, tilt @ covariances @ tilt.T, roll, pitch, clock, tilted)
