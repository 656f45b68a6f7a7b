"""How far the figures of a sample may lie from those of all such frames: 95 % intervals.

All take frames for independent. Those of one flight share errors (map, clock, drift), so for the
next flight the figures may lie farther out.
"""

import math

import numpy as np
from scipy.special import bdtr, stdtrit

from uasthn_cli.types import BoolArray, FloatArray

Interval = tuple[float, float | None]
"""From and to; None: so few frames give no upper end."""

_TAIL = 0.025
_NORMAL_975 = 1.959963984540054
"""Quantile of the normal distribution for a two-sided interval of 95 %."""


def wilson_interval(hits: int, trials: int) -> tuple[float, float]:
    """Return the 95 % interval of a share of ``trials`` > 0.

    Source: Wilson, *Probable Inference, the Law of Succession, and Statistical Inference*, JASA
    22 (1927), equation for the limits.
    """
    share, z2 = hits / trials, _NORMAL_975**2
    centre = share + z2 / (2.0 * trials)
    reach = _NORMAL_975 * math.sqrt((share * (1.0 - share) + z2 / (4.0 * trials)) / trials)
    scale = 1.0 + z2 / trials
    # At the ends the limit is the share itself; rounding would put it beyond.
    low, high = (centre - reach) / scale, (centre + reach) / scale
    return min(max(low, 0.0), share), max(min(high, 1.0), share)


def share_intervals(**flags: BoolArray) -> dict[str, Interval]:
    """Return Wilson's interval of the share that is true, for each ``(n,)`` that is not empty."""
    return {
        name: wilson_interval(int(values.sum()), values.size)
        for name, values in flags.items()
        if values.size
    }


def quantile_interval(errors_m: FloatArray, quantile: float) -> Interval:
    """Return the interval of a quantile of errors ``(n,)``, n > 0, whatever their distribution.

    Between two order statistics: how many of n errors lie below the true quantile is binomial
    (David and Nagaraja, *Order Statistics*, 3rd edition 2003, section 7.1). From 0, below which no
    error is, where no order statistic is low enough.
    """
    ordered, count = np.sort(errors_m), errors_m.size
    at_most = bdtr(np.arange(count, dtype=np.float64), count, quantile)  # k or fewer below it
    low = int((at_most <= _TAIL).sum())  # of the low-th smallest: fewer than low are below
    reaching = np.flatnonzero(1.0 - at_most <= _TAIL)
    high = float(ordered[reaching[0]]) if reaching.size else None
    return float(ordered[low - 1]) if low else 0.0, high


def mean_interval(values: FloatArray) -> tuple[float, float] | None:
    """Return Student's interval of the mean of values ``(n,)`` >= 0; None of fewer than two."""
    if values.size <= 1:
        return None
    deviation = float(values.std(ddof=1)) / math.sqrt(values.size)
    reach = float(stdtrit(values.size - 1, 1.0 - _TAIL)) * deviation
    mean = float(values.mean())
    return max(mean - reach, 0.0), mean + reach


def rms_interval(values: FloatArray) -> tuple[float, float] | None:
    """Return the interval of the root mean square of values ``(n,)``, from that of the squares."""
    squares = mean_interval(values**2)
    return squares and (math.sqrt(squares[0]), math.sqrt(squares[1]))
