import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.uncertainty.conformal import (
    Certificate,
    Refusal,
    accepted_needed,
    binomial_p_value,
    certify,
    conformal_scale,
    risk_upper_bound,
    threshold_sequence,
)

SHARES = st.floats(0.01, 0.99)


@st.composite
def counts(draw: st.DrawFn) -> tuple[int, int]:
    """Draw errors and accepted frames."""
    accepted = draw(st.integers(0, 400))
    return draw(st.integers(0, accepted)), accepted


def test_p_value_by_hand() -> None:
    assert binomial_p_value(0, 3, 0.5) == pytest.approx(1 / 8)
    assert binomial_p_value(1, 3, 0.5) == pytest.approx(4 / 8)
    assert binomial_p_value(3, 3, 0.5) == 1.0
    assert binomial_p_value(0, 0, 0.5) == 1.0


@given(counts=counts(), target=SHARES, confidence=SHARES)
def test_the_bound_is_the_risk_that_the_test_just_refutes(
    counts: tuple[int, int], target: float, confidence: float
) -> None:
    bound = risk_upper_bound(*counts, confidence)
    p_value = binomial_p_value(*counts, target)
    if abs(bound - target) > 1e-9:
        assert (bound < target) == (p_value < 1 - confidence)


@given(target=st.floats(0.01, 0.5), confidence=SHARES, errors=st.integers(0, 20))
def test_frames_needed_are_the_fewest_that_suffice(
    target: float, confidence: float, errors: int
) -> None:
    needed = accepted_needed(target, confidence, errors)
    assert binomial_p_value(errors, needed, target) <= 1 - confidence
    assert binomial_p_value(errors, needed - 1, target) > 1 - confidence


def test_frames_needed_without_errors_follow_the_logarithms() -> None:
    assert accepted_needed(0.05, 0.9) == math.ceil(math.log(0.1) / math.log(0.95)) == 45
    assert accepted_needed(0.01, 0.95) == math.ceil(math.log(0.05) / math.log(0.99)) == 299


RISKS = np.arange(100) / 100.0
THRESHOLDS = np.array([0.495, 0.595, 0.695, 0.795])


def test_the_laxest_threshold_before_the_first_failure() -> None:
    is_error = (RISKS > 0.6) & (RISKS < 0.7)  # 9 in 70; past 0.7 there is none again
    assert certify(RISKS, is_error, THRESHOLDS, 0.05, 0.9) == Certificate(0.595, 60, 0)


def test_a_refusal_says_what_was_missing() -> None:
    is_error = RISKS < 0.02
    refusal = certify(RISKS, is_error, THRESHOLDS, 0.05, 0.9)
    assert refusal == Refusal(accepted=50, errors=2, accepted_needed=105)


@given(seed=st.integers(0, 10_000), target=st.floats(0.02, 0.5), confidence=st.floats(0.5, 0.99))
def test_what_is_certified_passes_its_own_test(seed: int, target: float, confidence: float) -> None:
    rng = np.random.default_rng(seed)
    risks = rng.random(200)
    is_error = rng.random(200) < 0.6 * risks
    outcome = certify(risks, is_error, np.linspace(0.1, 0.9, 30), target, confidence)
    if isinstance(outcome, Certificate):
        assert outcome.accepted == (risks <= outcome.threshold).sum()
        assert outcome.errors == is_error[risks <= outcome.threshold].sum()
        assert risk_upper_bound(outcome.errors, outcome.accepted, confidence) <= target + 1e-12
        fewer = certify(risks, is_error & (risks > 0.5), np.linspace(0.1, 0.9, 30), target, 0.5)
        assert isinstance(fewer, Certificate)
        assert fewer.threshold >= outcome.threshold or confidence < 0.5
    else:
        assert outcome.accepted_needed is not None
        assert outcome.accepted < outcome.accepted_needed


def test_the_promise_is_kept_as_often_as_stated_and_by_the_naive_threshold_it_is_not() -> None:
    rng = np.random.default_rng(5)
    thresholds = np.linspace(0.2, 1.0, 50)
    # errors have probability risk / 4: the true risk of all below t is t / 8, beyond 0.1 past 0.8
    broken, naive_broken, certified = 0, 0, 0
    for _ in range(1000):
        risks = rng.random(400)
        is_error = rng.random(400) < risks / 4
        outcome = certify(risks, is_error, thresholds, 0.1, 0.9)
        if isinstance(outcome, Certificate):
            certified += 1
            broken += outcome.threshold / 8 > 0.1
        kept = [t for t in thresholds if is_error[risks <= t].mean() <= 0.1]
        naive_broken += bool(kept) and kept[-1] / 8 > 0.1
    assert certified > 800
    assert broken / 1000 <= 0.1 + 3 * math.sqrt(0.1 * 0.9 / 1000)
    assert naive_broken / 1000 > 0.4


def test_the_sequence_begins_where_success_is_likeliest_and_ends_at_the_worst_seen() -> None:
    rng = np.random.default_rng(2)
    risks = rng.random(500)
    is_error = rng.random(500) < np.where(risks < 0.6, 0.01, 0.5)
    sequence = threshold_sequence(0.3 * risks, is_error, 0.075)
    assert 0.15 < sequence[0] < 0.195
    assert sequence[-1] == 0.3 * risks.max()
    assert (np.diff(sequence) > 0).all()


def test_no_threshold_accepts_what_says_itself_that_it_is_far_too_risky() -> None:
    rng = np.random.default_rng(2)
    risks = 0.3 * rng.random(500)
    is_error = rng.random(500) < 0.001
    assert threshold_sequence(risks, is_error, 0.05)[-1] <= 4 * 0.05
    assert len(threshold_sequence(0.5 + risks, is_error, 0.05)) == 1


@given(count=st.integers(9, 200), seed=st.integers(0, 1000))
def test_the_scale_is_the_corrected_quantile(count: int, seed: int) -> None:
    ratios = np.random.default_rng(seed).exponential(size=count)
    scale = conformal_scale(ratios)
    covered = int((ratios <= scale).sum())
    assert scale in ratios
    assert covered >= 0.9 * (count + 1) - 1e-6
    assert covered - 1 < 0.9 * (count + 1)


def test_fewer_than_nine_frames_give_no_scale() -> None:
    assert conformal_scale(np.ones(8)) == math.inf
    assert conformal_scale(np.ones(9)) == 1.0


def test_the_scale_covers_the_next_frame() -> None:
    rng = np.random.default_rng(3)
    covered = [rng.exponential() <= conformal_scale(rng.exponential(size=19)) for _ in range(4000)]
    # 18 of 20 exchangeable frames: exactly 0.9
    assert np.mean(covered) == pytest.approx(0.9, abs=3 * math.sqrt(0.09 / 4000))
