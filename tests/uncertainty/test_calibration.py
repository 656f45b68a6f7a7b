import copy
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from uasthn_cli.config import BUNDLED_CALIBRATION
from uasthn_cli.errors import CalibrationError
from uasthn_cli.uncertainty.calibration import (
    AnswerKind,
    Calibration,
    Judgement,
    load_calibration,
)
from uasthn_cli.uncertainty.risk_model import RiskModel, SignalTerm, Transform

JUDGEMENT = Judgement(
    model=RiskModel((SignalTerm("u_m", Transform.LOG_METRES, 1.5, 0.7, 0.9),), bias=-2.1),
    max_risk=0.1,
    ce90_scale=1.3,
    fit_frames=90,
    frames=100,
    accepted=80,
    errors=1,
    ce90_frames=80,
)
CALIBRATION = Calibration(25.0, 0.05, 0.9, JUDGEMENT, None, note="two flights")


@pytest.mark.parametrize("fused", [None, replace(JUDGEMENT, max_risk=0.0, accepted=0, errors=0)])
def test_through_a_file_and_back(tmp_path: Path, fused: Judgement | None) -> None:
    calibration = replace(CALIBRATION, fused=fused)
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(calibration.to_json()))
    assert load_calibration(path) == calibration
    assert calibration.single.accepted_fraction == 0.8


def test_a_file_that_says_whose_answers_it_speaks_of_and_one_that_does_not() -> None:
    of_ihn = replace(CALIBRATION, made_of=AnswerKind("ihn", "de"))
    assert Calibration.from_json(of_ihn.to_json()) == of_ihn
    earlier = CALIBRATION.to_json()
    del earlier["made_of"]
    assert Calibration.from_json(earlier) == CALIBRATION


def damaged(path: str, value: Any) -> dict[str, Any]:
    """Return the document with one value replaced, or removed where ``value`` is ``...``."""
    document = json.loads(json.dumps(CALIBRATION.to_json()))
    *parents, last = [int(step) if step.isdigit() else step for step in path.split("/")]
    node = document
    for step in parents:
        node = node[step]
    if value is ...:
        del node[last]
    else:
        node[last] = value
    return copy.deepcopy(document)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("format", "uasthn-calibration-2", "not a calibration of format uasthn-calibration-1"),
        ("tolerance_m", ..., "tolerance_m is missing"),
        ("tolerance", 25, "tolerance is not known"),
        ("tolerance_m", -1, "tolerance_m is -1, expected a number between 0 and inf"),
        ("target_risk", 1.0, "target_risk is 1.0"),
        ("confidence_level", True, "confidence_level is True"),
        ("note", 3, "note is 3, expected text"),
        ("made_of", "ihn", "made_of is 'ihn', expected an object"),
        ("made_of", {"estimator": "ihn"}, "made_of: ue is missing"),
        ("single", None, "single is None, expected an object"),
        ("single/max_risk", float("nan"), "single: max_risk is nan"),
        ("single/max_risk", 1.0, "single: max_risk is 1.0"),
        ("single/ce90_scale", 0, "single: ce90_scale is 0"),
        ("single/frames", 2.5, "single: frames is 2.5, expected a whole number"),
        ("single/errors", 81, "single: frames, accepted and errors contradict each other"),
        ("single/model/terms", [], "single: model: terms is []"),
        ("single/model/terms/0/signal", "mood", "terms[0]: signal is 'mood'"),
        ("single/model/terms/0/transform", "sqrt", "transform is 'sqrt', expected log-metres"),
        ("single/model/terms/0/deviation", 0.0, "deviation is 0.0"),
        ("single/model/bias", "-2", "single: model: bias is '-2'"),
    ],
)
def test_what_is_damaged_is_named(path: str, value: Any, message: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        Calibration.from_json(damaged(path, value), "a.json")
    assert str(caught.value).startswith("a.json: ")
    assert message in str(caught.value)


@pytest.mark.parametrize(("content", "message"), [(None, "cannot be read"), ("{", "not JSON")])
def test_unreadable_files(tmp_path: Path, content: str | None, message: str) -> None:
    path = tmp_path / "calibration.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(CalibrationError, match=message) as caught:
        load_calibration(path)
    assert caught.value.exit_code == 25
    assert str(path) in str(caught.value)


def test_the_bundled_calibration_is_sound() -> None:
    assert load_calibration(BUNDLED_CALIBRATION).to_json()
