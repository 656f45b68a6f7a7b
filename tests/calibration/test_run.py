import logging
import math
from dataclasses import replace

import numpy as np
import pytest
from answer_tables import make_answers

from uasthn_cli.calibration.answers import RunAnswers, joined
from uasthn_cli.calibration.run import (
    CalibrationSettings,
    acceptance_risks,
    calibrate,
    judge,
)
from uasthn_cli.errors import CalibrationError
from uasthn_cli.uncertainty.calibration import Calibration, Unit

SETTINGS = CalibrationSettings()


def test_the_promise_holds_for_the_whole_population_as_often_as_stated() -> None:
    population = make_answers(40_000, 999)
    is_error = population.is_error(25.0)
    runs, certified, broken = 150, 0, 0
    for seed in range(runs):
        judgement, refusal = judge(make_answers(1200, seed), SETTINGS)
        accepted = acceptance_risks(judgement.model, population) <= judgement.max_risk
        certified += refusal is None
        broken += bool(accepted.any() and is_error[accepted].mean() > 0.05)
    assert certified > runs / 2
    assert broken / runs <= 0.1 + 3 * math.sqrt(0.1 * 0.9 / runs)


def test_ce90_covers_nine_tenths_of_accepted_frames_of_other_flights() -> None:
    judgement, _ = judge(make_answers(4000, 1, wrong=0.05), SETTINGS)
    fresh = make_answers(4000, 2, wrong=0.05)
    accepted = acceptance_risks(judgement.model, fresh) <= judgement.max_risk
    covered = fresh.error_m[accepted] <= judgement.ce90_scale * fresh.ce90_m[accepted]
    assert covered.mean() == pytest.approx(0.9, abs=0.03)
    assert judgement.ce90_frames == judgement.accepted


def test_what_is_told_of_the_certification_is_what_happened_there() -> None:
    answers = joined([make_answers(500, k, flight=k, wrong=0.1) for k in range(4)])
    judgement, refusal = judge(answers, SETTINGS)
    _, certified_on = answers.halves(SETTINGS.seed)
    accepted = acceptance_risks(judgement.model, certified_on) <= judgement.max_risk
    assert refusal is None
    assert (judgement.fit_frames, judgement.frames) == (1000, 1000)
    assert judgement.accepted == accepted.sum() > 0
    assert judgement.errors == certified_on.is_error(25.0)[accepted].sum()


def test_frames_with_impossible_corners_are_never_accepted() -> None:
    answers = make_answers(800, 1, wrong=0.02)
    answers.acceptable[:400] = False
    judgement, _ = judge(answers, SETTINGS)
    _, certified_on = answers.halves(SETTINGS.seed)
    assert 0 < judgement.accepted <= certified_on.acceptable.sum()
    assert judgement.frames == 400


def test_when_all_are_right_no_frame_that_looks_worse_than_any_seen_is_accepted() -> None:
    answers = make_answers(400, 1)
    answers.error_m[:] = 5.0
    judgement, _ = judge(answers, SETTINGS)
    typical = {name: float(np.median(values)) for name, values in answers.signals.items()}
    assert judgement.errors == 0
    assert judgement.accepted_fraction > 0.95
    assert judgement.model.risk(typical) <= judgement.max_risk
    assert judgement.model.risk(typical | {"sigma_m": 1e6}) > judgement.max_risk


def test_a_kind_that_cannot_be_certified_accepts_nothing_and_says_so(
    caplog: pytest.LogCaptureFixture,
) -> None:
    runs = RunAnswers(make_answers(400, 1, wrong=0.9), make_answers(400, 2, wrong=0.02))
    with caplog.at_level(logging.WARNING):
        calibration = calibrate(runs, SETTINGS, "note")
    assert "single: a risk of 0.05 cannot be certified with confidence 0.9" in caplog.text
    assert calibration.single.max_risk == 0.0
    assert calibration.single.accepted == calibration.single.ce90_frames == 0
    assert calibration.fused is not None
    assert calibration.fused.max_risk > 0.0
    assert Calibration.from_json(calibration.to_json()) == calibration


def test_nothing_to_certify_is_an_error_that_says_what_would_do() -> None:
    runs = RunAnswers(make_answers(60, 1, wrong=0.02), None)
    with pytest.raises(CalibrationError, match="without any 45"):
        calibrate(runs, SETTINGS, "note")


def test_too_few_frames_for_two_halves() -> None:
    with pytest.raises(CalibrationError, match="1 frames, of which 1 have an answer"):
        judge(make_answers(1, 1), SETTINGS)


def test_without_predicted_radii_no_scale_is_learned() -> None:
    answers = make_answers(400, 1, wrong=0.02)
    answers.ce90_m[:] = np.nan
    judgement, _ = judge(answers, SETTINGS)
    assert (judgement.ce90_scale, judgement.ce90_frames) == (1.0, 0)


@pytest.mark.slow
def test_repeated_frames_weaken_the_promise_and_thinning_restores_it() -> None:
    population = make_answers(40_000, 999)
    is_error = population.is_error(25.0)

    def broken(repeats: int, thin: int, runs: int = 200) -> float:
        count = 0
        for seed in range(runs):
            answers = make_answers(2400 // repeats, seed)
            answers = answers.rows(np.repeat(np.arange(len(answers)), repeats))
            judgement, _ = judge(answers, CalibrationSettings(seed=seed, thin=thin))
            accepted = acceptance_risks(judgement.model, population) <= judgement.max_risk
            count += bool(accepted.any() and is_error[accepted].mean() > 0.05)
        return count / runs

    assert broken(repeats=1, thin=1) <= 0.1
    assert broken(repeats=5, thin=1) > 0.15
    assert broken(repeats=5, thin=5) <= 0.1


def test_thinning_leaves_fewer_frames() -> None:
    judgement, _ = judge(make_answers(900, 1, wrong=0.02), CalibrationSettings(thin=3))
    assert judgement.frames + judgement.fit_frames == 300


@pytest.mark.slow
def test_repeated_frames_within_flights_do_not_weaken_a_promise_about_flights() -> None:
    population = make_answers(40_000, 999)
    is_error = population.is_error(25.0)

    def outcome(unit: Unit, repeats: int, runs: int = 200) -> tuple[float, float]:
        broken = certified = 0
        for seed in range(runs):
            answers = make_answers(1200, seed)
            flight = np.arange(1200) // 4  # 300 flights of four different frames
            answers = replace(answers, flight=flight).rows(np.repeat(np.arange(1200), repeats))
            judgement, refusal = judge(answers, CalibrationSettings(seed=seed, unit=unit))
            accepted = acceptance_risks(judgement.model, population) <= judgement.max_risk
            certified += refusal is None
            broken += bool(accepted.any() and is_error[accepted].mean() > 0.05)
        return broken / runs, certified / runs

    broken, certified = outcome(Unit.FLIGHT, repeats=5)
    assert broken <= 0.1
    assert certified > 0.5
    assert outcome(Unit.FRAME, repeats=5)[0] > 0.15


def test_what_happens_in_one_flight_counts_once() -> None:
    answers = joined([make_answers(24, k, flight=k, wrong=0.02) for k in range(80)])
    often = answers.rows(np.repeat(np.arange(len(answers)), 7))
    once, _ = judge(answers, CalibrationSettings(unit=Unit.FLIGHT, target_risk=0.1))
    repeated, _ = judge(often, CalibrationSettings(unit=Unit.FLIGHT, target_risk=0.1))
    assert once.max_risk > 0
    assert repeated.accepted_fraction == pytest.approx(once.accepted_fraction, abs=0.1)


def test_few_flights_promise_frames_and_say_so(caplog: pytest.LogCaptureFixture) -> None:
    few = RunAnswers(joined([make_answers(200, k, flight=k, wrong=0.02) for k in range(4)]), None)
    with caplog.at_level(logging.WARNING):
        calibration = calibrate(few, SETTINGS, "note")
    assert calibration.unit is Unit.FRAME
    assert "4 flights are too few" in caplog.text
    assert "60 are needed" in caplog.text
    with pytest.raises(CalibrationError, match=r"of 3 flights .* without any 45"):
        calibrate(few, replace(SETTINGS, unit=Unit.FLIGHT), "note")


def test_enough_flights_are_promised_about() -> None:
    parts = [make_answers(24, k, flight=k, wrong=0.01) for k in range(60)]
    for part in parts:
        part.error_m[:] = 5.0
    calibration = calibrate(RunAnswers(joined(parts), None), SETTINGS, "note")
    assert calibration.unit is Unit.FLIGHT
    assert "mean over flights" in calibration.promise
    assert Calibration.from_json(calibration.to_json()) == calibration
