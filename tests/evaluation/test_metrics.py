import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from known_estimator import made_up_predictions

from uasthn_cli.config import DecisionConfig, UeMethod
from uasthn_cli.evaluation.judging import Judged, JudgingConfig, judge
from uasthn_cli.evaluation.metrics import acceptance_curve, roc_of, score

TEN_METRES = JudgingConfig(DecisionConfig(max_std_m=10.0))


def judged_samples(errors_m: list[float], std_m: list[float]) -> Judged:
    some = made_up_predictions(np.array(errors_m), np.array(std_m))
    return judge(some, UeMethod.CROPTTA, TEN_METRES)


def test_figures_worked_out_by_hand() -> None:
    scores = score(judged_samples([4.0, 8.0, 60.0, 100.0], [1.0, 5.0, 8.0, 30.0]))
    assert scores.samples == scores.answered == 4
    assert scores.accepted_fraction == 0.75
    assert scores.mace_m == pytest.approx(24.0)
    assert scores.ce_m == pytest.approx(24.0)
    assert scores.mace_all_m == pytest.approx(43.0)
    assert scores.accepted_within == pytest.approx(2 / 3)
    assert scores.within_all == 0.5
    assert scores.auc == 1.0
    assert scores.aurc == pytest.approx((0 + 0 + 1 / 3 + 1 / 2) / 4)


def test_nothing_accepted_has_no_error() -> None:
    scores = score(judged_samples([4.0, 60.0], [11.0, 12.0]))
    assert scores.accepted_fraction == 0.0
    assert scores.mace_m is None
    assert scores.ce_m is None
    assert scores.accepted_within is None


def test_without_uncertainty_there_is_no_curve() -> None:
    some = made_up_predictions(np.array([4.0, 60.0]), np.array([1.0, 2.0]))
    none = judge(some, UeMethod.NONE, TEN_METRES)
    assert roc_of(none) is None
    assert score(none).auc is None
    assert score(none).aurc is None


def test_tolerance_is_in_metres_of_mace() -> None:
    judged = judged_samples([30.0, 60.0], [1.0, 2.0])
    assert roc_of(judged, 25.0) is None
    curve = roc_of(judged, 40.0)
    assert curve is not None
    assert curve.auc == 1.0


@given(
    st.lists(st.tuples(st.floats(0.0, 200.0), st.floats(0.1, 50.0)), min_size=2, max_size=20),
    st.floats(0.1, 60.0),
)
def test_the_curve_holds_what_every_threshold_accepts(
    samples: list[tuple[float, float]], limit_m: float
) -> None:
    errors_m, std_m = (np.array(column) for column in zip(*samples, strict=True))
    some = made_up_predictions(errors_m, std_m)
    judged = judge(some, UeMethod.CROPTTA, JudgingConfig(DecisionConfig(max_std_m=limit_m)))
    curve = acceptance_curve(judged)
    assert (np.diff(curve.accepted_fraction) > 0).all()
    assert curve.accepted_fraction[-1] == 1.0
    below = curve.threshold_m <= limit_m
    scores = score(judged)
    if not below.any():
        assert scores.accepted_fraction == 0.0
    else:
        assert curve.accepted_fraction[below][-1] == pytest.approx(scores.accepted_fraction)
        assert curve.mace_m[below][-1] == pytest.approx(scores.mace_m)


def test_a_sample_without_an_answer_is_never_on_the_curve() -> None:
    some = made_up_predictions(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    some.answers_px[2] = np.nan
    curve = acceptance_curve(judge(some, UeMethod.CROPTTA, TEN_METRES))
    np.testing.assert_allclose(curve.accepted_fraction, [1 / 3, 2 / 3])
