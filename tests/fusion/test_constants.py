"""What stays wrong throughout a flight is found, with an honest standard error."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from uasthn_cli.fusion.constants import (
    Constant,
    FlightConstants,
    ScoreFrames,
    clock_constant,
    constants_of_views,
    paraboloid_peak,
)
from uasthn_cli.seam import Similarity
from uasthn_cli.types import FloatArray

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


def frames_that_fit(
    yaw_deg: float, scale: float, count: int, *, gain: float = 4.0, seed: int = 0
) -> ScoreFrames:
    """Return scores of frames that each fit best near a turn and scale, falling off as normals do.

    Frames scatter by 0.8° and 1 %; ``gain`` is the height of their peaks in nats.
    """
    rng = np.random.default_rng(seed)
    yaws = math.radians(yaw_deg) + np.radians(rng.normal(0.0, 0.8, count))
    logs = math.log(scale) + rng.normal(0.0, 0.01, count)

    def score(hypotheses: Sequence[Similarity]) -> FloatArray:
        turn = np.array([entry.yaw_rad for entry in hypotheses])
        log_scale = np.log([entry.scale for entry in hypotheses])
        off = ((turn - yaws[:, None]) / math.radians(2.0)) ** 2
        off += ((log_scale - logs[:, None]) / 0.025) ** 2
        return np.asarray(gain * np.exp(-0.5 * off))

    return score


def found_by(score: ScoreFrames) -> tuple[Constant, Constant]:
    constants = constants_of_views(score)
    assert constants is not None
    return constants


@pytest.mark.parametrize(("yaw_deg", "scale"), [(2.5, 1.04), (-3.1, 0.97), (1.7, 1.0)])
def test_yaw_and_scale_are_where_frames_together_fit_best(yaw_deg: float, scale: float) -> None:
    yaw, log_scale = found_by(frames_that_fit(yaw_deg, scale, 12))
    assert (yaw.count, log_scale.count) == (12, 12)
    assert math.degrees(yaw.value) == pytest.approx(yaw_deg, abs=0.6)
    assert log_scale.value == pytest.approx(math.log(scale), abs=0.008)
    assert yaw.is_significant
    assert FlightConstants(yaw, log_scale).yaw_to_apply_rad == yaw.value


def test_standard_errors_hold_the_scatter_over_many_flights() -> None:
    found = [found_by(frames_that_fit(2.0, 0.97, 12, seed=seed)) for seed in range(60)]
    yaws = np.array([yaw.value for yaw, _ in found])
    errors = np.array([yaw.error for yaw, _ in found])
    assert yaws.std() < errors.mean() < 3 * yaws.std()


def test_a_frame_that_errs_does_not_move_the_constants() -> None:
    good, bad = frames_that_fit(2.5, 1.04, 11), frames_that_fit(-5.0, 0.93, 1)
    yaw, log_scale = found_by(lambda tried: np.concatenate([good(tried), bad(tried)]))
    assert math.degrees(yaw.value) == pytest.approx(2.5, abs=0.8)
    assert log_scale.value == pytest.approx(math.log(1.04), abs=0.012)


def test_what_hardly_fits_better_than_the_log_is_no_constant() -> None:
    assert constants_of_views(frames_that_fit(2.5, 1.04, 12, gain=0.4)) is None
    assert constants_of_views(frames_that_fit(0.0, 1.0, 12)) is None


def test_what_lies_beyond_a_logs_errors_is_no_constant() -> None:
    assert constants_of_views(frames_that_fit(9.0, 1.0, 12)) is None


def test_nothing_is_applied_where_nothing_is_known() -> None:
    nothing = FlightConstants()
    assert nothing.yaw_to_apply_rad == nothing.clock_to_apply_s == 0.0
    assert nothing.scale_to_apply == 1.0


def test_the_peak_of_a_paraboloid_lies_between_the_steps() -> None:
    steps = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])
    top = np.array([0.3, -0.2])
    scores = 5.0 - ((steps - top) ** 2 @ [1.0, 2.0])
    np.testing.assert_allclose(paraboloid_peak(steps, scores), top, atol=1e-9)


def test_scores_without_a_peak_answer_with_their_best_step() -> None:
    steps = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])
    np.testing.assert_array_equal(paraboloid_peak(steps, steps @ [1.0, 1.0]), [1.0, 1.0])


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
