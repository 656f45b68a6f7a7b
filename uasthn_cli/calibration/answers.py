"""Answers with known errors, as arrays: what models are fitted to and promises tested on."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.types import BoolArray, FloatArray
from uasthn_cli.uncertainty.calibration import AnswerKind
from uasthn_cli.uncertainty.risk_model import SIGNALS

IndexArray = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Answers:
    """One kind of answer (single-frame or fused), a row per frame, in the order of the tables.

    ``flight`` ``(n,)`` numbers the results folders; ``error_m`` ``(n,)`` is NaN where there is no
    answer. ``acceptable`` ``(n,)`` is false where no risk model is asked: no answer, or corners
    that are impossible. ``ce90_m`` ``(n,)`` is the predicted 90 % radius before any scale and
    without the map's own error, ``map_ce90_m`` ``(n,)`` that of the map, which adds to it in
    quadrature. ``signals`` holds every known signal ``(n,)``; NaN where a cell is empty.
    """

    flight: IndexArray
    error_m: FloatArray
    acceptable: BoolArray
    ce90_m: FloatArray
    map_ce90_m: FloatArray
    signals: Mapping[str, FloatArray]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.flight)

    def rows(self, chosen: IndexArray | BoolArray) -> "Answers":
        """Return some of the frames."""
        return Answers(
            flight=self.flight[chosen],
            error_m=self.error_m[chosen],
            acceptable=self.acceptable[chosen],
            ce90_m=self.ce90_m[chosen],
            map_ce90_m=self.map_ce90_m[chosen],
            signals={name: values[chosen] for name, values in self.signals.items()},
        )

    def is_error(self, tolerance_m: float) -> BoolArray:
        """Tell ``(n,)`` which answers lie beyond a tolerance; no answer is beyond any."""
        return ~(self.error_m <= tolerance_m)

    def needed_scales(self) -> FloatArray:
        """Return the scales ``(m,)`` that would just hold the errors of answers with a radius."""
        known = self.ce90_m > 0
        beyond_map2 = np.maximum(self.error_m[known] ** 2 - self.map_ce90_m[known] ** 2, 0.0)
        return np.asarray(np.sqrt(beyond_map2) / self.ce90_m[known])

    def ce90_coverage(self, scale: float) -> float:
        """Return the share of answers with a radius whose scaled radius holds their error."""
        known = np.isfinite(self.ce90_m)
        radius_m = np.hypot(scale * self.ce90_m[known], self.map_ce90_m[known])
        return float(np.mean(self.error_m[known] <= radius_m)) if known.any() else math.nan

    def thinned(self, every: int) -> "Answers":
        """Return every n-th frame of each flight, so that neighbours are farther apart."""
        order_in_flight = np.empty(len(self), dtype=np.intp)
        for flight in np.unique(self.flight):
            own = self.flight == flight
            order_in_flight[own] = np.arange(own.sum())
        return self.rows(order_in_flight % every == 0)

    def as_one_flight(self) -> "Answers":
        """Return the same frames without regard to flights, to be dealt one by one."""
        return replace(self, flight=np.zeros_like(self.flight))

    def halves(self, seed: int, first_share: float = 0.5) -> tuple["Answers", "Answers"]:
        """Return two parts that share no frame and, where there are several flights, no flight.

        Which goes where is drawn from the seed; whole flights are dealt so that the first part is
        as near to its share of the frames as their order allows.
        """
        rng = np.random.default_rng(seed)
        flights, sizes = np.unique(self.flight, return_counts=True)
        if flights.size < 2:
            is_first = rng.permutation(len(self)) < int(len(self) * first_share)
        else:
            order = rng.permutation(flights.size)
            ends = np.cumsum(sizes[order])[:-1]
            count = 1 + int(np.argmin(np.abs(ends - len(self) * first_share)))
            is_first = np.isin(self.flight, flights[order[:count]])
        return self.rows(is_first), self.rows(~is_first)


@dataclass(frozen=True, slots=True)
class RunAnswers:
    """Single-frame and fused answers of some runs; ``fused`` is None where none was fused.

    ``kind`` says whose answers they are; None where the runs do not.
    """

    single: Answers
    fused: Answers | None
    kind: AnswerKind | None = None


def joined(parts: Sequence[Answers]) -> Answers:
    """Return the frames of at least one table below each other."""
    return Answers(
        flight=np.concatenate([part.flight for part in parts]),
        error_m=np.concatenate([part.error_m for part in parts]),
        acceptable=np.concatenate([part.acceptable for part in parts]),
        ce90_m=np.concatenate([part.ce90_m for part in parts]),
        map_ce90_m=np.concatenate([part.map_ce90_m for part in parts]),
        signals={name: np.concatenate([part.signals[name] for part in parts]) for name in SIGNALS},
    )
