"""From signals to trust, with a calibration and without."""

import math
from dataclasses import replace

import numpy as np
import pytest

from uasthn_cli.config import (
    FALLBACK_MAX_STD_M,
    FALLBACK_MIN_CONFIDENCE,
    MAP_PIXEL_ERROR,
    MIN_SUPPORT,
    DecisionConfig,
    GeotagConfig,
)
from uasthn_cli.fusion.offsets import PosteriorSummary
from uasthn_cli.pipeline.trust_model import Agreement, TrustModel
from uasthn_cli.types import Attitude, FloatArray, OffsetLikelihood, Reason, Trust
from uasthn_cli.uncertainty.calibration import Calibration, Judgement
from uasthn_cli.uncertainty.decide import Rejection
from uasthn_cli.uncertainty.risk_model import RiskModel, SignalTerm, Transform

STD_M = np.array([[1.0, 2.0], [1.0, 2.0], [3.0, 2.0], [3.0, 6.0]])
SUMMARY = PosteriorSummary(0.9, 3.0, 6.0, np.array([[4.0, 1.0], [1.0, 9.0]]))
NEAR = Agreement(2.0, 0.75)


def calibration(signal: str, fused_signal: str | None = None) -> Calibration:
    """Return one whose risk falls or rises with one signal, per kind of answer."""

    def judgement(name: str, scale: float) -> Judgement:
        share = name in {"confidence", "support"}
        transform = Transform.LOGIT if share else Transform.LOG_METRES
        weight = -1.0 if share else 1.0
        model = RiskModel((SignalTerm(name, transform, 0.0, 1.0, weight),), 0.0)
        return Judgement(model, 0.3, scale, 90, 100, 80, 1, 80)

    fused = None if fused_signal is None else judgement(fused_signal, 3.0)
    return Calibration(25.0, 0.05, 0.9, judgement(signal, 2.0), fused, note="")


def trust_model(calibrated: Calibration | None = None, **settings: object) -> TrustModel:
    config = replace(GeotagConfig(map_error_m=0.0), **settings)  # type: ignore[arg-type]
    return TrustModel(config, calibrated, map_pixel_m=0.0)


def peak(east_cells: int) -> OffsetLikelihood:
    """Return a likelihood of one cell of 4 m."""
    values = np.full((21, 21), -60.0)
    values[10, 10 + east_cells] = 0.0
    return OffsetLikelihood.of(values, 4.0, np.zeros(2))


def single(model: TrustModel, offset_m: FloatArray | None = None) -> Trust:
    where = np.zeros(2) if offset_m is None else offset_m
    return model.single(peak(0), where, 3.0, 0.123, STD_M)


def test_without_a_calibration_there_is_no_risk() -> None:
    trust = single(trust_model())
    assert math.isnan(trust.risk)
    assert trust.confidence == pytest.approx(1.0)  # that of the likelihood, not the estimator's
    assert trust.covariance_m2 == pytest.approx(np.eye(2) * 16 / 12)
    assert math.isnan(trust.agreement_m)
    assert math.isnan(trust.support)


def test_covariance_is_taken_about_the_answer() -> None:
    trust = single(trust_model(), np.array([3.0, 0.0]))
    assert trust.covariance_m2 == pytest.approx(np.diag([9.0, 0.0]) + np.eye(2) * 16 / 12)


def test_an_estimator_without_scores_is_judged_by_its_views() -> None:
    trust = trust_model().single(None, np.zeros(2), 3.0, 0.7, STD_M)
    assert trust.confidence == 0.7
    assert math.isnan(trust.entropy_nats)
    assert math.isnan(trust.sigma_m)
    assert trust.covariance_m2 == pytest.approx(np.diag([5.0, 12.0]))


def test_the_maps_own_error_is_added_and_never_scaled() -> None:
    plain = single(trust_model(map_error_m=3.0))
    scaled = single(trust_model(calibration("u_m"), map_error_m=3.0))
    assert plain.covariance_m2 == pytest.approx(np.eye(2) * (16 / 12 + 9.0))
    assert scaled.covariance_m2 == pytest.approx(np.eye(2) * (4.0 * 16 / 12 + 9.0))
    assert scaled.ce90_m == pytest.approx(math.sqrt(-2 * math.log(0.1) * (64 / 12 + 9.0)))


def test_the_maps_pixels_leave_something_open_too() -> None:
    coarse = TrustModel(GeotagConfig(map_error_m=0.0), None, map_pixel_m=5.0)
    expected = 16 / 12 + (MAP_PIXEL_ERROR * 5.0) ** 2
    assert single(coarse).covariance_m2 == pytest.approx(np.eye(2) * expected)


LEVEL = Attitude(0.0, 0.0, math.radians(30.0))


def test_the_camera_has_the_error_of_the_centre_and_that_of_the_attitude() -> None:
    centre = trust(covariance_m2=np.diag([4.0, 9.0]))
    found = trust_model(attitude_error_deg=math.degrees(0.01)).camera(centre, LEVEL, 300.0)
    assert found.covariance_m2 == pytest.approx(np.diag([13.0, 18.0]))
    assert found.ce90_m == pytest.approx(math.sqrt(-2 * math.log(0.1) * 15.5))


def test_what_a_flight_tells_of_its_attitude_takes_the_place_of_the_default() -> None:
    told = trust_model().camera(trust(covariance_m2=np.eye(2)), LEVEL, 300.0, np.zeros((2, 2)))
    assert told.covariance_m2 == pytest.approx(np.eye(2))


def test_single_and_fused_answers_have_their_own_models() -> None:
    model = trust_model(calibration("u_m", "support"))
    assert single(model).risk == pytest.approx(1 / (1 + 1 / 3))  # odds of u_m: 3
    fused = model.fused(SUMMARY, SUMMARY.covariance_m2, NEAR, 3.0)
    assert fused.risk == pytest.approx(1 / (1 + 3))  # odds of support 3 to 1, counted against it
    assert fused.covariance_m2 == pytest.approx(9.0 * SUMMARY.covariance_m2)
    assert (fused.agreement_m, fused.support) == (2.0, 0.75)


def test_a_calibration_without_fused_answers_judges_them_as_single() -> None:
    model = trust_model(calibration("u_m"))
    fused = model.fused(SUMMARY, SUMMARY.covariance_m2, NEAR, 3.0)
    assert fused.risk == pytest.approx(1 / (1 + 1 / 3))
    blank = model.fused(SUMMARY, SUMMARY.covariance_m2, NEAR, math.nan)
    assert blank.risk == 1.0
    assert reason(model.rejection_of_fused(blank)) is Reason.RISKY


def test_whatever_the_risk_most_neighbours_must_agree() -> None:
    for model in (trust_model(), trust_model(calibration("u_m", "support"))):
        sure = trust(risk=0.0, confidence=1.0, support=MIN_SUPPORT + 0.01)
        assert model.rejection_of_fused(sure) is None
        assert (
            reason(model.rejection_of_fused(replace(sure, support=MIN_SUPPORT)))
            is Reason.UNSUPPORTED
        )
        assert (
            reason(model.rejection_of_fused(replace(sure, support=math.nan))) is Reason.UNSUPPORTED
        )


def reason(found: Rejection | None) -> Reason | None:
    return found.reason if found else None


def test_a_lack_of_support_says_how_much_there_is() -> None:
    found = trust_model().rejection_of_fused(trust(support=0.4))
    assert found == Rejection(Reason.UNSUPPORTED, "support 0.40, more than 0.60 needed")


def trust(**changes: float | FloatArray) -> Trust:
    nothing_known = Trust(1.0, 1.0, 1.0, np.eye(2), 2.0, math.nan, math.nan, math.nan)
    return replace(nothing_known, **changes)  # type: ignore[arg-type]


def test_without_a_calibration_fused_answers_need_confidence_and_support() -> None:
    model = trust_model()
    enough, little = FALLBACK_MIN_CONFIDENCE, FALLBACK_MIN_CONFIDENCE - 0.01
    assert model.rejection_of_fused(trust(confidence=enough, support=1.0)) is None
    assert (
        reason(model.rejection_of_fused(trust(confidence=little, support=1.0))) is Reason.AMBIGUOUS
    )


def test_the_spread_of_views_rejects_single_answers_alone() -> None:
    model = trust_model(decision=DecisionConfig(max_std_m=0.001))
    assert reason(model.rejection_of_single(1.0, trust(), 500.0)) is Reason.UNCERTAIN
    assert model.rejection_of_fused(trust(support=1.0)) is None
    fallback = trust_model()
    assert (
        reason(fallback.rejection_of_single(FALLBACK_MAX_STD_M + 1, trust(), 500.0))
        is Reason.UNCERTAIN
    )


def test_with_a_calibration_each_kind_has_its_limit() -> None:
    whole = calibration("u_m", "support")
    assert whole.fused is not None
    stricter = replace(whole, fused=replace(whole.fused, max_risk=0.1))
    model = trust_model(stricter)
    risky = trust(risk=0.2, confidence=0.0, support=1.0)
    assert model.rejection_of_single(1e3, risky, 500.0) is None
    assert reason(model.rejection_of_fused(risky)) is Reason.RISKY
    assert model.rejection_of_fused(replace(risky, risk=0.1)) is None
