"""The risk that an answer is wrong, from the signals that come with it."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final

import numpy as np

from uasthn_cli.types import FloatArray

_LEAST_M: Final = 0.1
"""Metres below which two spreads are the same: far below a pixel of any map."""
_LEAST_SHARE: Final = 1e-4
"""The last decimal of a share in ``frames.csv``."""
_LARGEST_LOGIT: Final = 30.0
"""Keeps every risk above 0, so that a threshold of 0 accepts nothing."""


class Transform(StrEnum):
    """What is done to a signal before it is weighed."""

    LOG_METRES = "log-metres"
    LOGIT = "logit"
    IDENTITY = "identity"

    def apply(self, values: FloatArray) -> FloatArray:
        """Return transformed values; NaN where a value is none of its kind (a length below 0)."""
        if self is Transform.LOG_METRES:
            return np.where(values >= 0, np.log(np.maximum(values, _LEAST_M)), np.nan)
        if self is Transform.LOGIT:
            shares = np.clip(values, _LEAST_SHARE, 1 - _LEAST_SHARE)
            is_share = (values >= 0) & (values <= 1)
            return np.where(is_share, np.log(shares / (1 - shares)), np.nan)
        return values


@dataclass(frozen=True, slots=True)
class Signal:
    """A kind of evidence; ``direction`` is +1 where more of it means more risk, else -1."""

    transform: Transform
    direction: int


SIGNALS: Final[Mapping[str, Signal]] = MappingProxyType(
    {
        "confidence": Signal(Transform.LOGIT, -1),
        "entropy": Signal(Transform.IDENTITY, 1),
        "sigma_m": Signal(Transform.LOG_METRES, 1),
        "u_m": Signal(Transform.LOG_METRES, 1),
        "agreement_m": Signal(Transform.LOG_METRES, 1),
        "support": Signal(Transform.LOGIT, -1),
    }
)
"""What a model may look at, by the names of the columns of ``frames.csv``."""


@dataclass(frozen=True, slots=True)
class SignalTerm:
    """One signal in a model: ``weight * (transformed - mean) / deviation``."""

    signal: str
    transform: Transform
    mean: float
    deviation: float
    weight: float


@dataclass(frozen=True, slots=True)
class RiskModel:
    """A logistic model of the probability that the centre error exceeds the tolerance."""

    terms: tuple[SignalTerm, ...]
    bias: float

    def risk(self, signals: Mapping[str, float]) -> float:
        """Return the risk of one answer; 1 where a signal of the model is missing or no number."""
        return float(self.risks({name: np.float64(value) for name, value in signals.items()}))

    def risks(self, signals: Mapping[str, FloatArray | np.float64]) -> FloatArray:
        """Return the risks ``(n,)`` of n answers whose signals are ``(n,)`` each."""
        logits: FloatArray = np.asarray(self.bias, dtype=np.float64)
        for term in self.terms:
            values = np.asarray(signals.get(term.signal, np.nan), dtype=np.float64)
            standard = (term.transform.apply(values) - term.mean) / term.deviation
            logits = logits + term.weight * standard
        bounded = np.clip(logits, -_LARGEST_LOGIT, _LARGEST_LOGIT)
        return np.where(np.isfinite(logits), 1 / (1 + np.exp(-bounded)), 1.0)
