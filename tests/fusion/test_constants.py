"""What stays wrong throughout a flight is found, with an honest standard error."""

import math

import numpy as np
import pytest

from uasthn_cli.fusion.constants import (
    Constant,
    FlightConstants,
    clock_constant,
    constants_of_views,
)
from uasthn_cli.types import FloatArray, Similarity

SPEED_M_S = 15.0
FRAME_S = 2.0


def lanes(count: int, frames_a_lane: int = 6) -> tuple[FloatArray, FloatArray]:
    """Return times ``(T,)`` and velocities ``(T, 2)`` of lanes flown east and west in turn."""
    total = count * frames_a_lane
    heading = 1.0 - 2.0 * ((np.arange(total) // frames_a_lane) % 2)
    velocities = np.stack([SPEED_M_S * heading, np.zeros(total)], axis=1)
    return FRAME_S * np.arange(float(total)), velocities


def wandering(count: int, step_m: float, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, step_m, (count, 2)).cumsum(axis=0)


@pytest.mark.parametrize("clock_s", [-1.2, 0.5, 2.0])
def test_convention_a_late_stamp_is_read_off_lanes_flown_both_ways(clock_s: float) -> None:
    """Frames stamped too early by ``clock_s`` were taken that much farther along the way."""
    times_s, velocities = lanes(10)
    offsets_m = clock_s * velocities + wandering(len(times_s), 1.0, 1) + [30.0, -12.0]
    found = clock_constant(times_s, offsets_m, velocities, noise_m=1.0)
    assert found is not None
    assert found.count == 9
    assert found.is_significant
    assert found.value == pytest.approx(clock_s, abs=3 * found.error)
    assert found.error < 0.1
    assert FlightConstants(clock_s=found).clock_to_apply_s == found.value


def test_its_standard_error_is_the_deviation_over_many_flights() -> None:
    times_s, velocities = lanes(12)
    found = []
    for seed in range(200):
        offsets_m = 0.4 * velocities + wandering(len(times_s), 4.0, seed)
        constant = clock_constant(times_s, offsets_m, velocities, noise_m=0.0)
        assert constant is not None
        found.append((constant.value, constant.error))
    values, errors = np.array(found).T
    assert values.mean() == pytest.approx(0.4, abs=0.02)
    # motion across the lanes says nothing of the clock, yet half the residuals come from there
    assert errors.mean() == pytest.approx(values.std(), rel=0.2)


def test_noise_bounds_the_standard_error_from_below() -> None:
    times_s, velocities = lanes(10)
    found = clock_constant(times_s, 0.1 * velocities, velocities, noise_m=4.0)
    assert found is not None
    assert found.value == pytest.approx(0.1)
    assert found.error == pytest.approx(4.0 / (2 * SPEED_M_S * 3))  # nine turns of twice the speed


def test_a_straight_flight_says_nothing_of_its_clock() -> None:
    times_s, velocities = lanes(1, 40)
    offsets_m = 1.5 * velocities + wandering(40, 1.0, 0)
    assert clock_constant(times_s, offsets_m, velocities, noise_m=1.0) is None
    assert clock_constant(times_s[:1], offsets_m[:1], velocities[:1], noise_m=1.0) is None
    assert clock_constant(times_s[:0], offsets_m[:0], velocities[:0], noise_m=1.0) is None


def test_few_turns_are_not_enough_to_correct_a_clock() -> None:
    times_s, velocities = lanes(4)
    found = clock_constant(times_s, 1.0 * velocities, velocities, noise_m=0.1)
    assert found is not None
    assert found.count == 3
    assert not found.is_significant
    assert FlightConstants(clock_s=found).clock_to_apply_s == 0.0


def test_a_correct_clock_stays_as_it_is() -> None:
    times_s, velocities = lanes(12)
    significant = 0
    for seed in range(100):
        found = clock_constant(times_s, wandering(len(times_s), 3.0, seed), velocities, 1.0)
        assert found is not None
        significant += found.is_significant
    assert significant <= 3


def views(yaw_deg: float, scale: float, count: int, seed: int = 0) -> list[Similarity]:
    rng = np.random.default_rng(seed)
    turns = np.radians(yaw_deg + rng.normal(0.0, 0.8, count))
    scales = scale * np.exp(rng.normal(0.0, 0.01, count))
    return [Similarity(float(yaw), float(size)) for yaw, size in zip(turns, scales, strict=True)]


def test_yaw_and_scale_are_the_frames_medians_with_their_standard_errors() -> None:
    yaw, log_scale = constants_of_views(views(2.5, 1.04, 12))
    assert yaw is not None
    assert log_scale is not None
    assert (yaw.count, log_scale.count) == (12, 12)
    assert math.degrees(yaw.value) == pytest.approx(2.5, abs=3 * math.degrees(yaw.error))
    assert log_scale.value == pytest.approx(math.log(1.04), abs=3 * log_scale.error)
    constants = FlightConstants(yaw, log_scale)
    assert constants.yaw_to_apply_rad == yaw.value
    assert constants.scale_to_apply == pytest.approx(1.04, abs=0.02)


def test_standard_errors_of_medians_are_their_deviations_over_many_flights() -> None:
    found = []
    for seed in range(300):
        yaw, log_scale = constants_of_views(views(1.0, 0.97, 12, seed))
        assert yaw is not None
        assert log_scale is not None
        found.append((yaw.value, yaw.error, log_scale.value, log_scale.error))
    yaws, yaw_errors, scales, scale_errors = np.array(found).T
    assert yaw_errors.mean() == pytest.approx(yaws.std(), rel=0.25)
    assert scale_errors.mean() == pytest.approx(scales.std(), rel=0.25)


def test_a_frame_that_errs_does_not_move_the_constants() -> None:
    astray = [*views(2.5, 1.04, 11), Similarity(math.radians(-8.0), 0.9)]
    yaw, log_scale = constants_of_views(astray)
    assert yaw is not None
    assert log_scale is not None
    assert math.degrees(yaw.value) == pytest.approx(2.5, abs=1.0)
    assert log_scale.value == pytest.approx(math.log(1.04), abs=0.012)


def test_few_frames_say_nothing() -> None:
    assert constants_of_views(views(2.5, 1.04, 5)) == (None, None)
    assert constants_of_views([]) == (None, None)
    nothing = FlightConstants()
    assert nothing.yaw_to_apply_rad == nothing.clock_to_apply_s == 0.0
    assert nothing.scale_to_apply == 1.0


@pytest.mark.parametrize(
    ("constant", "expected"),
    [
        (Constant(3.1, 1.0, 6), True),
        (Constant(-3.1, 1.0, 6), True),
        (Constant(2.9, 1.0, 6), False),
        (Constant(3.1, 1.0, 5), False),
    ],
)
def test_only_what_chance_does_not_explain_is_corrected(constant: Constant, expected: bool) -> None:
    assert constant.is_significant is expected
    assert FlightConstants(yaw_rad=constant).yaw_to_apply_rad == (constant.value if expected else 0)
