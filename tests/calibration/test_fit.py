import numpy as np
import pytest
from answer_tables import make_answers

from uasthn_cli.calibration.fit import fit_risk_model
from uasthn_cli.errors import CalibrationError
from uasthn_cli.uncertainty.risk_model import SIGNALS


def test_estimated_risks_are_true_frequencies_on_other_frames() -> None:
    learnt, fresh = make_answers(3000, 1), make_answers(3000, 2)
    model = fit_risk_model(learnt.signals, learnt.is_error(25.0))
    risks = model.risks(fresh.signals)
    is_error = fresh.is_error(25.0)
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 0.7), (0.7, 1.0)):
        inside = (risks >= low) & (risks < high)
        assert is_error[inside].mean() == pytest.approx(risks[inside].mean(), abs=0.06)


def test_weights_keep_the_direction_of_their_signal_against_the_data() -> None:
    answers = make_answers(500, 3)
    model = fit_risk_model(answers.signals, ~answers.is_error(25.0))
    assert {term.signal for term in model.terms} == set(SIGNALS) - {"agreement_m", "support"}
    assert all(term.weight * SIGNALS[term.signal].direction >= 0 for term in model.terms)


def test_without_any_error_frames_are_still_ranked() -> None:
    answers = make_answers(300, 4)
    model = fit_risk_model(answers.signals, np.zeros(300, dtype=np.bool_))
    risks = model.risks(answers.signals)
    assert risks.max() < 0.1
    assert np.corrcoef(risks, answers.signals["sigma_m"])[0, 1] > 0.5


def test_a_signal_that_is_often_empty_or_never_varies_is_not_used() -> None:
    answers = make_answers(300, 5)
    signals = dict(answers.signals)
    signals["entropy"] = np.where(np.arange(300) % 5 == 0, np.nan, signals["entropy"])
    signals["u_m"] = np.zeros(300)
    model = fit_risk_model(signals, answers.is_error(25.0))
    assert [term.signal for term in model.terms] == ["confidence", "sigma_m"]


def test_no_signal_at_all_is_said() -> None:
    nothing = dict.fromkeys(SIGNALS, np.full(30, np.nan))
    with pytest.raises(CalibrationError, match="no signal to judge answers by"):
        fit_risk_model(nothing, np.zeros(30, dtype=np.bool_))
