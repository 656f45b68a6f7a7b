import math
from itertools import permutations
from random import Random

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.stats import mannwhitneyu

from uasthn_cli.report.trust import (
    FRAMES_PER_BIN,
    MOST_BINS,
    ReliabilityBin,
    expected_calibration_error,
    radius_coverage,
    reliability_bins,
    risk_coverage,
    roc_curve,
)
from uasthn_cli.types import BoolArray, FloatArray

# Few distinct uncertainties: ties are the hard case.
ANSWERS = st.lists(st.tuples(st.integers(0, 8), st.booleans()), min_size=1, max_size=60)


def arrays(answers: list[tuple[int, bool]]) -> tuple[FloatArray, BoolArray]:
    uncertainty, wrong = zip(*answers, strict=True)
    return np.array(uncertainty, dtype=np.float64), np.array(wrong)


def test_roc_by_hand() -> None:
    roc = roc_curve(np.array([1.0, 2.0, 2.0, 3.0]), np.array([False, False, True, True]))
    assert roc is not None
    assert_allclose(roc.true_positive_rate, [0, 0.5, 1, 1])
    assert_allclose(roc.false_positive_rate, [0, 0, 0.5, 1])
    assert roc.auc == 0.875  # of four pairs three are in order, one is tied


@given(ANSWERS)
def test_auc_is_the_mann_whitney_statistic(answers: list[tuple[int, bool]]) -> None:
    uncertainty, wrong = arrays(answers)
    roc = roc_curve(uncertainty, wrong)
    if wrong.all() or not wrong.any():
        assert roc is None
        return
    assert roc is not None
    u = mannwhitneyu(uncertainty[wrong], uncertainty[~wrong], method="asymptotic").statistic
    assert roc.auc == pytest.approx(u / (wrong.sum() * (~wrong).sum()))
    opposite = roc_curve(-uncertainty, wrong)
    assert opposite is not None
    assert roc.auc + opposite.auc == pytest.approx(1.0)
    for rate in (roc.true_positive_rate, roc.false_positive_rate):
        assert (rate[0], rate[-1]) == (0.0, 1.0)
        assert (np.diff(rate) >= 0.0).all()


def test_risk_coverage_by_hand() -> None:
    curve = risk_coverage(np.array([3.0, 1.0, 2.0]), np.array([False, False, True]))
    assert curve is not None
    assert_allclose(curve.coverage, [1 / 3, 2 / 3, 1])
    assert_allclose(curve.risk, [0, 1 / 2, 1 / 3])
    assert_allclose(curve.ideal_risk, [0, 0, 1 / 3])
    assert curve.aurc == pytest.approx((1 / 2 + 1 / 3) / 3)
    assert curve.ideal_aurc == pytest.approx(1 / 9)


@given(ANSWERS, st.randoms(use_true_random=False))
def test_risk_coverage_asks_only_for_the_order(
    answers: list[tuple[int, bool]], random: Random
) -> None:
    curve = risk_coverage(*arrays(answers))
    random.shuffle(answers)
    uncertainty, wrong = arrays(answers)
    other = risk_coverage(np.exp(uncertainty) - 100.0, wrong)
    assert curve is not None
    assert other is not None
    assert_allclose(curve.risk, other.risk)
    assert curve.ideal_aurc - 1e-12 <= curve.aurc
    assert curve.risk[-1] == pytest.approx(wrong.mean())
    ideal = risk_coverage(wrong.astype(np.float64), wrong)
    assert ideal is not None
    assert ideal.aurc == pytest.approx(curve.ideal_aurc)


@given(st.lists(st.tuples(st.integers(0, 2), st.booleans()), min_size=1, max_size=5))
def test_ties_stand_for_the_mean_over_their_orders(answers: list[tuple[int, bool]]) -> None:
    uncertainty, wrong = arrays(answers)
    curve = risk_coverage(uncertainty, wrong)
    orders = [np.array(order) for order in permutations(range(len(answers)))]
    broken = [risk_coverage(10.0 * uncertainty + order, wrong) for order in orders]
    assert curve is not None
    assert_allclose(curve.risk, np.mean([one.risk for one in broken if one], axis=0))


def test_no_answer_has_no_curve() -> None:
    nothing, none_wrong = np.zeros(0), np.zeros(0, dtype=np.bool_)
    assert roc_curve(nothing, none_wrong) is None
    assert risk_coverage(nothing, none_wrong) is None
    assert reliability_bins(nothing, none_wrong) == ()
    assert expected_calibration_error(()) is None
    assert radius_coverage(nothing, nothing) is None


@given(st.lists(st.tuples(st.integers(0, 20), st.booleans()), max_size=250))
def test_bins_share_out_the_answers_in_order(answers: list[tuple[int, bool]]) -> None:
    assume(answers)
    steps, wrong = arrays(answers)
    risk = steps / 20.0
    bins = reliability_bins(risk, wrong)
    assert len(bins) <= min(MOST_BINS, max(1, risk.size // FRAMES_PER_BIN))
    assert sum(one.frames for one in bins) == risk.size
    assert sum(one.frames * one.observed for one in bins) == pytest.approx(wrong.sum())
    assert sum(one.frames * one.predicted for one in bins) == pytest.approx(risk.sum())
    assert (np.diff([one.predicted for one in bins]) > 0.0).all()
    assert all(one.observed_low <= one.observed <= one.observed_high for one in bins)
    error = expected_calibration_error(bins)
    assert error is not None
    assert abs(risk.mean() - wrong.mean()) - 1e-12 <= error <= 1.0


def test_bins_of_distinct_risks_are_even() -> None:
    risk = np.linspace(0.0, 1.0, 200)
    bins = reliability_bins(risk[::-1], np.zeros(200, dtype=np.bool_))
    assert [one.frames for one in bins] == [20] * 10


def test_calibrated_risk_has_a_small_error_and_overconfident_risk_a_large_one() -> None:
    random = np.random.default_rng(5)
    risk = random.uniform(0.0, 1.0, 20_000)
    wrong = random.uniform(size=risk.size) < risk
    calibrated = expected_calibration_error(reliability_bins(risk, wrong))
    overconfident = expected_calibration_error(reliability_bins(risk**3, wrong))
    assert calibrated is not None
    assert overconfident is not None
    assert calibrated < 0.02
    assert overconfident == pytest.approx(1 / 2 - 1 / 4, abs=0.02)


def test_calibration_error_by_hand() -> None:
    bins = (ReliabilityBin(30, 0.1, 0.2, 0.0, 1.0), ReliabilityBin(10, 0.9, 0.5, 0.0, 1.0))
    assert expected_calibration_error(bins) == pytest.approx((30 * 0.1 + 10 * 0.4) / 40)


def test_radius_coverage_by_hand() -> None:
    ce_m, ce90_m = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 1.0, 5.0, 5.0])
    assert radius_coverage(ce_m, ce90_m) == 0.75  # an error as large as its radius is within
    unknown = np.array([math.nan, 9.0, math.nan, 9.0])
    assert radius_coverage(ce_m, unknown) == 1.0  # of the two that have a radius
    assert radius_coverage(unknown, np.full(4, math.nan)) is None


@pytest.mark.parametrize("level", [0.1, 0.5, 0.8, 0.9, 0.95, 0.99])
def test_circular_normal_errors_are_covered_at_every_level(level: float) -> None:
    random = np.random.default_rng(3)
    sigma_m = random.uniform(2.0, 20.0, 40_000)
    ce_m = np.hypot(*random.normal(0.0, sigma_m, (2, sigma_m.size)))
    ce90_m = sigma_m * math.sqrt(-2.0 * math.log(0.1))
    assert radius_coverage(ce_m, ce90_m, level) == pytest.approx(level, abs=0.01)
