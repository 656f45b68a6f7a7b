"""What stays wrong throughout a flight: mount yaw, height or field of view, and the clock."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uasthn_cli.types import FloatArray, Similarity

_TO_DEVIATION = 1.4826
"""From a median absolute deviation to a standard deviation, for normal values."""
_MEDIAN_COST = 1.2533
"""How much less certain a median is than a mean: sqrt(pi / 2)."""
_LEAST_FRAMES = 6
_SIGNIFICANT = 3.0
_LEAST_TURN_M_S = 2.0
"""Between frames of one heading a late clock looks like a shift of the position."""


@dataclass(frozen=True, slots=True)
class Constant:
    """A value, its standard error, and how many frames (or turns) it rests on."""

    value: float
    error: float
    count: int

    @property
    def is_significant(self) -> bool:
        """Tell whether it differs from 0 by more than chance."""
        return self.count >= _LEAST_FRAMES and abs(self.value) > _SIGNIFICANT * self.error


@dataclass(frozen=True, slots=True)
class FlightConstants:
    """What a flight's own frames say of its camera and clock; None where too few say anything.

    ``yaw_rad`` is to be added to the logged heading (or the mount yaw), ``log_scale`` to the
    logarithm of the height (or of the tangent of half the field of view), ``clock_s`` to the
    frames' times.
    """

    yaw_rad: Constant | None = None
    log_scale: Constant | None = None
    clock_s: Constant | None = None

    @property
    def yaw_to_apply_rad(self) -> float:
        """Turn that is certain enough to be corrected."""
        return _applied(self.yaw_rad)

    @property
    def scale_to_apply(self) -> float:
        """Factor on the height that is certain enough to be corrected."""
        return math.exp(_applied(self.log_scale))

    @property
    def clock_to_apply_s(self) -> float:
        """Time offset that is certain enough to be corrected."""
        return _applied(self.clock_s)


def constants_of_views(similarities: Sequence[Similarity]) -> tuple[Constant | None, ...]:
    """Return the flight's turn (radians) and log scale from those of its frames: medians."""
    if len(similarities) < _LEAST_FRAMES:
        return None, None
    yaw = _median(np.array([entry.yaw_rad for entry in similarities]))
    log_scale = _median(np.log([entry.scale for entry in similarities]))
    return yaw, log_scale


def clock_constant(
    times_s: FloatArray, offsets_m: FloatArray, velocities_m_s: FloatArray, noise_m: float
) -> Constant | None:
    """Return by how much frames are stamped too early (seconds), from how offsets turn with flight.

    ``offsets_m`` ``(T, 2)`` are the errors of the log's positions, ``velocities_m_s`` ``(T, 2)``.
    A frame stamped too early by ``c`` was taken ``c`` times the velocity farther on. The offsets'
    own wandering is slow, so differences between frames are regressed on differences of velocity;
    ``noise_m`` is the least deviation of such a difference. None where the heading hardly changes.
    """
    if len(times_s) <= 1:
        return None
    change_m, turn_m_s = np.diff(offsets_m, axis=0), np.diff(velocities_m_s, axis=0)
    turns = np.linalg.norm(turn_m_s, axis=1) > _LEAST_TURN_M_S
    if turns.sum() < 2:
        return None
    change, turn = change_m[turns].ravel(), turn_m_s[turns].ravel()
    power = float(turn @ turn)
    value = float(turn @ change) / power
    residual = change - value * turn
    deviation = max(float(np.sqrt(np.mean(residual**2))), noise_m)
    return Constant(value, deviation / math.sqrt(power), int(turns.sum()))


def _median(values: FloatArray) -> Constant:
    middle = float(np.median(values))
    deviation = _TO_DEVIATION * float(np.median(np.abs(values - middle)))
    return Constant(middle, _MEDIAN_COST * deviation / math.sqrt(len(values)), len(values))


def _applied(constant: Constant | None) -> float:
    return constant.value if constant is not None and constant.is_significant else 0.0
