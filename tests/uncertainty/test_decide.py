"""Accept or reject, in which order, and by which of eight deviations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.config import (
    FALLBACK_MAX_STD_M,
    FALLBACK_MIN_CONFIDENCE,
    DecisionConfig,
    Rule,
)
from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.types import FloatArray, Reason
from uasthn_cli.uncertainty.decide import (
    Rejection,
    impossible_corners,
    rejection,
    scalar_uncertainty,
    told_apart,
)

FULL = image_corners_px(64, 48)
STD_M = np.array([[4.0, 5.0], [6.0, 7.0], [8.0, 9.0], [10.0, 19.0]])
WINDOW_M = 512.0
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


def reason_of(
    config: DecisionConfig,
    uncertainty_m: float = 4.0,
    confidence: float = 0.9,
    risk: float = math.nan,
    max_risk: float | None = None,
) -> Reason | None:
    found = rejection(uncertainty_m, confidence, risk, WINDOW_M, config, max_risk)
    return found.reason if found else None


def corners_reason(corners_px: FloatArray) -> Reason | None:
    found = impossible_corners(FULL, corners_px, 0.25)
    return found.reason if found else None


@pytest.mark.parametrize(
    ("rule", "expected"), [(Rule.ALL, 4.0), (Rule.ANY, 19.0), (Rule.MEAN, 8.5)]
)
def test_rules_name_the_deviation_that_decides(rule: Rule, expected: float) -> None:
    assert scalar_uncertainty(STD_M, rule) == pytest.approx(expected)


def test_the_papers_rule_rejects_when_every_deviation_is_larger() -> None:
    config = DecisionConfig(max_std_m=3.9)
    assert config.rule is Rule.ALL
    assert reason_of(config, scalar_uncertainty(STD_M, config.rule)) is Reason.UNCERTAIN
    one_is_small = STD_M.copy()
    one_is_small[2, 1] = 3.8
    assert reason_of(config, scalar_uncertainty(one_is_small, config.rule)) is None


def test_what_equals_the_threshold_is_not_above_it() -> None:
    assert reason_of(DecisionConfig(max_std_m=4.0)) is None
    assert reason_of(DecisionConfig(max_std_m=math.nextafter(4.0, 0.0))) is Reason.UNCERTAIN


def test_convention_thresholds_in_pixels_count_at_a_window_of_256() -> None:
    assert reason_of(DecisionConfig(max_std_px=2.01)) is None
    assert reason_of(DecisionConfig(max_std_px=1.99)) is Reason.UNCERTAIN


@pytest.mark.parametrize("confidence", [0.49, 0.0, math.nan])
def test_little_belief_is_ambiguous(confidence: float) -> None:
    config = DecisionConfig(min_confidence=0.5)
    assert reason_of(config, confidence=confidence) is Reason.AMBIGUOUS
    assert reason_of(config, confidence=0.5) is None


def test_without_calibration_and_limits_the_fallbacks_decide() -> None:
    config = DecisionConfig()
    assert reason_of(config, FALLBACK_MAX_STD_M, FALLBACK_MIN_CONFIDENCE) is None
    assert reason_of(config, FALLBACK_MAX_STD_M + 0.01, 1.0) is Reason.UNCERTAIN
    assert reason_of(config, 0.0, FALLBACK_MIN_CONFIDENCE - 0.01) is Reason.AMBIGUOUS


def test_one_limit_of_the_users_leaves_the_other_fallback() -> None:
    lenient = DecisionConfig(max_std_m=99.0)
    assert reason_of(lenient, 98.0, FALLBACK_MIN_CONFIDENCE - 0.01) is Reason.AMBIGUOUS
    assert reason_of(DecisionConfig(max_std_px=49.0), 97.0, 1.0) is None
    trusting = DecisionConfig(min_confidence=0.0)
    assert reason_of(trusting, FALLBACK_MAX_STD_M + 0.01, 0.0) is Reason.UNCERTAIN


def test_with_a_calibration_only_the_risk_counts() -> None:
    config = DecisionConfig()
    assert reason_of(config, 1e6, 0.0, risk=0.1, max_risk=0.1) is None
    assert reason_of(config, math.nan, math.nan, risk=0.0, max_risk=0.1) is None
    assert reason_of(config, 0.0, 1.0, risk=0.1001, max_risk=0.1) is Reason.RISKY


@pytest.mark.parametrize("risk", [math.nan, 1.0])
def test_a_risk_that_nobody_knows_is_too_high(risk: float) -> None:
    assert reason_of(DecisionConfig(), risk=risk, max_risk=0.99) is Reason.RISKY


def test_limits_of_the_users_hold_beside_a_calibration() -> None:
    config = DecisionConfig(max_std_m=3.0, min_confidence=0.5)
    assert reason_of(config, 3.1, 0.4, risk=1.0, max_risk=0.1) is Reason.UNCERTAIN
    assert reason_of(config, 3.0, 0.4, risk=1.0, max_risk=0.1) is Reason.AMBIGUOUS
    assert reason_of(config, 3.0, 0.5, risk=1.0, max_risk=0.1) is Reason.RISKY
    assert reason_of(config, 3.0, 0.5, risk=0.1, max_risk=0.1) is None


@given(confidence=NUMBERS, uncertainty_m=NUMBERS, risk=st.floats(0, 1), larger=st.floats(0, 1))
def test_a_larger_limit_never_rejects_more(
    confidence: float, uncertainty_m: float, risk: float, larger: float
) -> None:
    for limit in (risk / 2, risk):
        if reason_of(DecisionConfig(), uncertainty_m, confidence, risk, limit) is None:
            wider = min(1.0, limit + larger)
            assert reason_of(DecisionConfig(), uncertainty_m, confidence, risk, wider) is None


def test_a_spread_that_is_no_number_is_uncertain() -> None:
    assert reason_of(DecisionConfig(), math.nan) is Reason.UNCERTAIN


@pytest.mark.parametrize("scale", [0.74, 1.26])
def test_a_footprint_of_another_size_is_implausible(scale: float) -> None:
    assert corners_reason(FULL * scale) is Reason.IMPLAUSIBLE_SCALE


@pytest.mark.parametrize("scale", [0.76, 1.24])
def test_a_footprint_of_about_its_size_is_plausible(scale: float) -> None:
    assert corners_reason(FULL * scale) is None


def not_finite() -> FloatArray:
    corners = FULL.copy()
    corners[1, 0] = np.nan
    return corners


@pytest.mark.parametrize(
    "corners_px",
    [
        FULL[[1, 0, 3, 2]],
        FULL[[0, 1, 3, 2]],
        np.array([[0, 0], [63, 0], [0, 47], [10.0, 10.0]]),
        not_finite(),
    ],
    ids=["mirrored", "crossed", "dented", "not finite"],
)
def test_what_no_camera_sees_is_degenerate(corners_px: FloatArray) -> None:
    assert corners_reason(corners_px) is Reason.DEGENERATE_HOMOGRAPHY


def test_degenerate_is_graver_than_implausible() -> None:
    crossed = 2 * FULL[[0, 1, 3, 2]]
    assert corners_reason(crossed) is Reason.DEGENERATE_HOMOGRAPHY


@pytest.mark.parametrize(
    ("signals", "config", "max_risk", "detail"),
    [
        ((4.0, 0.2, 0.1), DecisionConfig(), None, "confidence 0.20 of 0.30 needed"),
        ((4.0, 0.9, 0.09), DecisionConfig(), 0.05, "risk 0.09, at most 0.05"),
        ((4.0, 0.9, 0.0512), DecisionConfig(), 0.0508, "risk 0.0512, at most 0.0508"),
        ((4.0, 0.9, math.nan), DecisionConfig(), 0.05, "risk unknown, at most 0.05"),
        (
            (12.346, 0.9, 0.0),
            DecisionConfig(),
            None,
            "frame and views disagree by 12.35 m, at most 10.00 m",
        ),
        (
            (12.3, 0.9, 0.0),
            DecisionConfig(max_std_px=4.0),
            0.5,
            "frame and views disagree by 12.30 m, at most 8.00 m",
        ),
    ],
)
def test_a_rejection_says_what_is_missing_and_by_how_much(
    signals: tuple[float, float, float],
    config: DecisionConfig,
    max_risk: float | None,
    detail: str,
) -> None:
    found = rejection(*signals, WINDOW_M, config, max_risk)
    assert isinstance(found, Rejection)
    assert found.detail == detail


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (1.5, "1.50 times as wide as height and camera have it, at most 1.25"),
        (0.5, "0.50 times as wide as height and camera have it, at least 0.75"),
    ],
)
def test_an_implausible_footprint_says_its_scale(scale: float, words: str) -> None:
    found = impossible_corners(FULL, FULL * scale, 0.25)
    assert found is not None
    assert words in found.detail


@given(value=st.floats(0, 1), limit=st.floats(0, 1))
def test_numbers_that_differ_by_a_millionth_are_told_apart(value: float, limit: float) -> None:
    found, shown = told_apart(value, limit)
    assert abs(float(found) - value) <= 0.005
    if abs(value - limit) > 1.1e-6:
        assert (float(found) < float(shown)) == (value < limit)
