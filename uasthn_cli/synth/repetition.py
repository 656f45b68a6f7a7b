"""Ground that looks the same everywhere: planted rows, orchards, solar fields, trains of dunes.

Each is a strictly periodic function of the place, so nothing tells one period from the next.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from uasthn_cli.types import FloatArray, ImageArray

_PERIODS_PER_FOOTPRINT = (5.0, 12.0)
_DUNE_LAG_RAD = 0.3 * math.pi


class Pattern(StrEnum):
    """What is repeated."""

    ROWS = "rows"
    ORCHARD = "orchard"
    PANELS = "panels"
    DUNES = "dunes"


@dataclass(frozen=True, slots=True)
class Repetition:
    """One pattern: its period across, turn, place, and whether what is bright by day is warm."""

    pattern: Pattern
    period_m: float
    angle_rad: float
    origin_m: tuple[float, float]
    sign: float

    def day(self, points_m: FloatArray) -> ImageArray:
        """Return brightness by day at places ``(..., 2)``, about -1 to 1."""
        return self._value(points_m, 0.0)

    def night(self, points_m: FloatArray) -> ImageArray:
        """Return warmth by night at places ``(..., 2)``, about -1 to 1.

        Dunes show the slope that faced another sun: their crests lag behind those by day.
        """
        lag_rad = _DUNE_LAG_RAD if self.pattern is Pattern.DUNES else 0.0
        return np.float32(self.sign) * self._value(points_m, lag_rad)

    def _value(self, points_m: FloatArray, lag_rad: float) -> ImageArray:
        """Return the pattern at places ``(..., 2)``."""
        turn = 2.0 * math.pi / self.period_m
        x, y = np.moveaxis(points_m - np.array(self.origin_m), -1, 0)
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        across, along = turn * (cos * x + sin * y), turn * (cos * y - sin * x)
        if self.pattern is Pattern.ROWS:
            value = np.tanh(3.0 * np.cos(across))
        elif self.pattern is Pattern.ORCHARD:
            value = np.tanh(3.0 * (np.cos(across) + np.cos(along) - 0.6))
        elif self.pattern is Pattern.PANELS:
            table = np.minimum(np.cos(across) + 0.3, np.cos(along / 3.0) + 0.9)
            value = np.tanh(6.0 * table)
        else:
            phase = across + 0.8 * np.sin(along / 4.0) + lag_rad
            value = np.sin(phase + 0.5 * np.sin(phase))
        return np.asarray(value, dtype=np.float32)


def draw_repetition(rng: np.random.Generator, footprint_m: float) -> Repetition:
    """Draw a pattern that repeats some five to twelve times across a frame."""
    pattern = list(Pattern)[int(rng.integers(len(Pattern)))]
    period_m = footprint_m / float(rng.uniform(*_PERIODS_PER_FOOTPRINT))
    x, y = rng.uniform(0.0, period_m, 2)
    angle_rad = float(rng.uniform(0.0, math.pi))
    return Repetition(
        pattern, period_m, angle_rad, (float(x), float(y)), float(rng.choice([-1, 1]))
    )
