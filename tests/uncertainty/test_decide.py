"""Accept or reject, in which order, and by which of eight deviations."""

import math

import numpy as np
import pytest

from uasthn_cli.config import DecisionConfig, Rule
from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.types import Decision, FloatArray, Reason
from uasthn_cli.uncertainty.decide import decide, scalar_uncertainty

FULL = image_corners_px(64, 48)
STD_M = np.array([[4.0, 5.0], [6.0, 7.0], [8.0, 9.0], [10.0, 19.0]])
WINDOW_M = 512.0


def judge(
    config: DecisionConfig,
    std_m: FloatArray = STD_M,
    confidence: float = 0.9,
    corners_px: FloatArray = FULL,
) -> Decision:
    return decide(std_m, confidence, FULL, corners_px, WINDOW_M, config)


@pytest.mark.parametrize(
    ("rule", "expected"), [(Rule.ALL, 4.0), (Rule.ANY, 19.0), (Rule.MEAN, 8.5)]
)
def test_rules_name_the_deviation_that_decides(rule: Rule, expected: float) -> None:
    assert scalar_uncertainty(STD_M, rule) == pytest.approx(expected)
    accepting = judge(DecisionConfig(max_std_m=expected + 0.01, rule=rule))
    rejecting = judge(DecisionConfig(max_std_m=expected - 0.01, rule=rule))
    assert (accepting.accepted, accepting.reason) == (True, None)
    assert (rejecting.accepted, rejecting.reason) == (False, Reason.UNCERTAIN)
    assert accepting.uncertainty_m == rejecting.uncertainty_m == pytest.approx(expected)


def test_the_papers_rule_rejects_when_every_deviation_is_larger() -> None:
    config = DecisionConfig(max_std_m=3.9)
    assert config.rule is Rule.ALL
    assert judge(config).reason is Reason.UNCERTAIN
    one_is_small = STD_M.copy()
    one_is_small[2, 1] = 3.8
    assert judge(config, one_is_small).accepted


def test_what_equals_the_threshold_is_not_above_it() -> None:
    assert judge(DecisionConfig(max_std_m=4.0)).accepted


def test_convention_thresholds_in_pixels_count_at_a_window_of_256() -> None:
    assert judge(DecisionConfig(max_std_m=0.0, max_std_px=2.01)).accepted
    assert judge(DecisionConfig(max_std_m=99.0, max_std_px=1.99)).reason is Reason.UNCERTAIN


def test_the_uncertainty_stays_in_metres() -> None:
    assert judge(DecisionConfig(max_std_px=1.0)).uncertainty_m == pytest.approx(4.0)


@pytest.mark.parametrize("confidence", [0.49, 0.0, math.nan])
def test_little_belief_is_ambiguous(confidence: float) -> None:
    config = DecisionConfig(min_confidence=0.5)
    assert judge(config, confidence=confidence).reason is Reason.AMBIGUOUS
    assert judge(config, confidence=0.5).accepted


@pytest.mark.parametrize("scale", [0.74, 1.26])
def test_a_footprint_of_another_size_is_implausible(scale: float) -> None:
    config = DecisionConfig(max_scale_error=0.25)
    assert judge(config, corners_px=FULL * scale).reason is Reason.IMPLAUSIBLE_SCALE


@pytest.mark.parametrize("scale", [0.76, 1.24])
def test_a_footprint_of_about_its_size_is_plausible(scale: float) -> None:
    assert judge(DecisionConfig(max_scale_error=0.25), corners_px=FULL * scale).accepted


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
    decision = judge(DecisionConfig(), corners_px=corners_px)
    assert decision.reason is Reason.DEGENERATE_HOMOGRAPHY
    assert not decision.accepted


def test_the_gravest_reason_is_named() -> None:
    """Degenerate before implausible before uncertain before ambiguous."""
    config = DecisionConfig(max_std_m=1.0, min_confidence=0.95)
    crossed = 2 * FULL[[0, 1, 3, 2]]
    assert judge(config, corners_px=crossed).reason is Reason.DEGENERATE_HOMOGRAPHY
    assert judge(config, corners_px=2 * FULL).reason is Reason.IMPLAUSIBLE_SCALE
    assert judge(config).reason is Reason.UNCERTAIN
    assert judge(config, STD_M / 10).reason is Reason.AMBIGUOUS


def test_a_spread_that_is_no_number_is_uncertain() -> None:
    nowhere = np.full((4, 2), np.nan)
    assert judge(DecisionConfig(), nowhere).reason is Reason.UNCERTAIN
