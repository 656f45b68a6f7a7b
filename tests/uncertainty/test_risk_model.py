import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.uncertainty.risk_model import SIGNALS, RiskModel, SignalTerm, Transform

MODEL = RiskModel(
    terms=(
        SignalTerm("confidence", Transform.LOGIT, mean=0.0, deviation=2.0, weight=-1.0),
        SignalTerm("u_m", Transform.LOG_METRES, mean=math.log(10.0), deviation=1.0, weight=0.5),
    ),
    bias=-1.0,
)

NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


def test_risk_by_hand() -> None:
    # logit(0.5) = 0 is the mean of the first term, log(10 m) that of the second: the bias is left
    assert MODEL.risk({"confidence": 0.5, "u_m": 10.0}) == pytest.approx(1 / (1 + math.e))
    # logit(0.8) = log 4, over 2, times -1; log(40 / 10) = log 4, times 0.5: they cancel
    assert MODEL.risk({"confidence": 0.8, "u_m": 40.0}) == pytest.approx(1 / (1 + math.e))


@pytest.mark.parametrize(
    "signals",
    [
        {},
        {"confidence": 0.9},
        {"confidence": 0.9, "u_m": math.nan},
        {"confidence": 0.9, "u_m": -1.0},
        {"confidence": 0.9, "u_m": math.inf},
        {"confidence": 1.1, "u_m": 1.0},
    ],
)
def test_a_signal_that_is_missing_or_impossible_is_a_risk_of_1(signals: dict[str, float]) -> None:
    assert MODEL.risk(signals) == 1.0


@given(confidence=NUMBERS, u_m=NUMBERS)
def test_every_risk_is_above_0_and_one_and_many_agree(confidence: float, u_m: float) -> None:
    one = MODEL.risk({"confidence": confidence, "u_m": u_m})
    many = MODEL.risks({"confidence": np.full(3, confidence), "u_m": np.full(3, u_m)})
    assert 0.0 < one <= 1.0
    assert many.tolist() == [one] * 3


@given(
    transform=st.sampled_from(list(Transform)),
    values=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
def test_transforms_keep_the_order(transform: Transform, values: tuple[float, float]) -> None:
    low, high = transform.apply(np.sort(np.array(values)))
    assert low <= high


def test_confidence_and_support_alone_speak_against_risk() -> None:
    against = [name for name, signal in SIGNALS.items() if signal.direction < 0]
    assert against == ["confidence", "support"]
