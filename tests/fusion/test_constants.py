"""What stays wrong throughout a flight is found, with an honest standard error."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from uasthn_cli.fusion.constants import (
    Constant,
    FlightConstants,
    ScoreFrames,
    constants_of_views,
    paraboloid_peak,
)
from uasthn_cli.seam import Similarity
from uasthn_cli.types import FloatArray


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
