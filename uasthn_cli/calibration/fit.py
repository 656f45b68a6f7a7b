"""Fit the risk model: a logistic regression that knows which way each signal points."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.optimize import minimize

from uasthn_cli.errors import CalibrationError
from uasthn_cli.types import BoolArray, FloatArray
from uasthn_cli.uncertainty.risk_model import SIGNALS, RiskModel, SignalTerm

LEAST_FILLED: Final = 0.9
"""Share of frames that must have a signal for the model to ask for it: one without is rejected."""

_LEAST_DEVIATION: Final = 1e-9
_PENALTY: Final = 1.0


def fit_risk_model(signals: Mapping[str, FloatArray], is_error: BoolArray) -> RiskModel:
    """Return a model of the risk from signals and outcomes ``(n,)`` of frames with an answer.

    Weights keep the sign that the signal's meaning gives them, and are drawn by a ridge towards
    equal ones: where hardly any answer was wrong, frames are still ranked by all signals together.
    Targets are smoothed as in Platt scaling (Platt 1999), which keeps the bias finite.

    Raises:
        CalibrationError: no signal is filled and varies.
    """
    columns = {name: SIGNALS[name].transform.apply(signals[name]) for name in SIGNALS}
    used = [name for name, values in columns.items() if _is_useful(values)]
    if not used:
        raise CalibrationError(
            f"no signal to judge answers by: of the columns {', '.join(SIGNALS)} none is filled and"
            " varies: run `uasthn geotag` again with this version"
        )
    matrix = np.column_stack([columns[name] for name in used])
    whole = np.isfinite(matrix).all(axis=1)
    if not whole.any():
        raise CalibrationError(f"no frame has all of the signals {', '.join(used)}")
    means, deviations = matrix[whole].mean(axis=0), matrix[whole].std(axis=0)
    deviations = np.maximum(deviations, _LEAST_DEVIATION)
    directions = np.array([SIGNALS[name].direction for name in used], dtype=np.float64)
    standard = (matrix[whole] - means) / deviations
    weights, bias = _logistic(standard, is_error[whole], directions)
    terms = tuple(
        SignalTerm(name, SIGNALS[name].transform, float(mean), float(deviation), float(weight))
        for name, mean, deviation, weight in zip(used, means, deviations, weights, strict=True)
    )
    return RiskModel(terms, bias)


def _is_useful(values: FloatArray) -> bool:
    filled = np.isfinite(values)
    if not filled.any() or filled.mean() < LEAST_FILLED:
        return False
    return bool(values[filled].std() > _LEAST_DEVIATION)


def _logistic(
    standard: FloatArray, is_error: BoolArray, directions: FloatArray
) -> tuple[FloatArray, float]:
    """Return weights ``(k,)`` and bias for standardised signals ``(n, k)``."""
    errors, count = int(is_error.sum()), len(is_error)
    targets = np.where(is_error, (errors + 1) / (errors + 2), 1 / (count - errors + 2))
    equal = directions / directions.size

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        weights, bias = parameters[:-1], parameters[-1]
        logits = standard @ weights + bias
        excess = 1 / (1 + np.exp(-logits)) - targets
        pull = weights - equal
        value = np.logaddexp(0.0, logits).sum() - targets @ logits + _PENALTY / 2 * pull @ pull
        return float(value), np.append(standard.T @ excess + _PENALTY * pull, excess.sum())

    start = np.append(equal, np.log((errors + 1) / (count - errors + 1)))
    bounds = [(0.0, None) if sign > 0 else (None, 0.0) for sign in directions]
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=[*bounds, (None, None)])
    return found.x[:-1], float(found.x[-1])
