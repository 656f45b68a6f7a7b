"""Does a stated uncertainty tell good answers from wrong ones? Pure functions of arrays.

Throughout, ``wrong`` ``(n,)`` tells which answers lie beyond the tolerance, and ``uncertainty``
``(n,)`` is any finite number that is larger the less an answer is trusted.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.report.intervals import wilson_interval
from uasthn_cli.types import BoolArray, FloatArray

IntArray = NDArray[np.int64]

MOST_BINS: Final = 10
FRAMES_PER_BIN: Final = 10


@dataclass(frozen=True, slots=True)
class Roc:
    """Which share of good and of wrong answers is flagged as the flag grows more suspicious.

    ``false_positive_rate`` and ``true_positive_rate`` are ``(k,)``, from (0, 0) to (1, 1). ``auc``
    is the chance that a wrong answer is more uncertain than a good one, a tie counting as half.
    """

    false_positive_rate: FloatArray
    true_positive_rate: FloatArray
    auc: float


@dataclass(frozen=True, slots=True)
class RiskCoverage:
    """The share of wrong answers among the ``coverage`` ``(n,)`` most trusted share: ``risk``.

    ``aurc`` is the mean of ``risk``, ``ideal_aurc`` what it would be if every good answer were
    trusted more than every wrong one (AURC and excess AURC of Geifman, Uziel and El-Yaniv,
    *Bias-Reduced Uncertainty Estimation for Deep Neural Classifiers*, ICLR 2019).
    """

    coverage: FloatArray
    risk: FloatArray
    ideal_risk: FloatArray
    aurc: float
    ideal_aurc: float


@dataclass(frozen=True, slots=True)
class ReliabilityBin:
    """Answers of similar predicted risk: its mean, the share that was wrong, its 95 % interval."""

    frames: int
    predicted: float
    observed: float
    observed_low: float
    observed_high: float


def roc_curve(uncertainty: FloatArray, wrong: BoolArray) -> Roc | None:
    """Return the receiver operating characteristic; None unless there are good and wrong answers.

    Equal uncertainties are one point of the curve, so the area is the Mann–Whitney statistic.
    """
    frames, wrong_frames = _tied_groups(uncertainty, wrong)
    hits = np.concatenate([[0], np.cumsum(wrong_frames[::-1])])
    alarms = np.concatenate([[0], np.cumsum((frames - wrong_frames)[::-1])])
    if hits[-1] == 0 or alarms[-1] == 0:
        return None
    true_positive_rate, false_positive_rate = hits / hits[-1], alarms / alarms[-1]
    heights = (true_positive_rate[1:] + true_positive_rate[:-1]) / 2.0
    auc = float(np.sum(np.diff(false_positive_rate) * heights))
    return Roc(false_positive_rate, true_positive_rate, auc)


def risk_coverage(uncertainty: FloatArray, wrong: BoolArray) -> RiskCoverage | None:
    """Return the risk–coverage curve, one point per answer; None of no answer.

    Within equal uncertainties the order is a matter of luck: the curve is the mean over all orders.
    """
    if wrong.size == 0:
        return None
    frames, wrong_frames = _tied_groups(uncertainty, wrong)
    taken = np.arange(1, wrong.size + 1)
    risk = np.cumsum(np.repeat(wrong_frames / frames, frames)) / taken
    ideal_risk = np.cumsum(np.sort(wrong)) / taken
    return RiskCoverage(
        coverage=taken / wrong.size,
        risk=risk,
        ideal_risk=ideal_risk,
        aurc=float(risk.mean()),
        ideal_aurc=float(ideal_risk.mean()),
    )


def reliability_bins(risk: FloatArray, wrong: BoolArray) -> tuple[ReliabilityBin, ...]:
    """Sort answers by predicted risk ``(n,)`` into bins of nearly equal count, surest first.

    There are at most ``MOST_BINS`` bins of about ``FRAMES_PER_BIN`` answers or more; equal risks
    share a bin, so bins can be fewer and uneven.
    """
    count = min(max(risk.size // FRAMES_PER_BIN, 1), MOST_BINS)
    first = np.arange(1, count) * risk.size // count
    bin_of = np.searchsorted(np.unique(np.sort(risk)[first]), risk, side="right")
    return tuple(_bin(risk[bin_of == k], wrong[bin_of == k]) for k in np.unique(bin_of))


def expected_calibration_error(bins: tuple[ReliabilityBin, ...]) -> float | None:
    """Return the mean distance of predicted from observed share over answers; None of no bin."""
    frames = sum(one.frames for one in bins)
    if frames == 0:
        return None
    return sum(one.frames * abs(one.predicted - one.observed) for one in bins) / frames


def radius_coverage(ce_m: FloatArray, ce90_m: FloatArray, level: float = 0.9) -> float | None:
    """Return the share of errors ``(n,)`` within their predicted radius; None of no error.

    At another level than 0.9 the radius is that of a circular normal error with the same CE90:
    squared, it is proportional to ``-ln(1 - level)`` (Rayleigh distribution).
    """
    within = within_radius(ce_m, ce90_m, level)
    return float(within.mean()) if within.size else None


def within_radius(ce_m: FloatArray, ce90_m: FloatArray, level: float = 0.9) -> BoolArray:
    """Tell which errors lie within their predicted radius, of those that are known with one."""
    known = np.isfinite(ce_m) & np.isfinite(ce90_m)
    scale = math.sqrt(math.log1p(-level) / math.log1p(-0.9))
    return np.asarray(ce_m[known] <= ce90_m[known] * scale)


def _tied_groups(uncertainty: FloatArray, wrong: BoolArray) -> tuple[IntArray, IntArray]:
    """Return answers and wrong answers ``(k,)`` per distinct uncertainty, the least first."""
    _, group, frames = np.unique(uncertainty, return_inverse=True, return_counts=True)
    return frames.astype(np.int64), np.bincount(group[wrong], minlength=frames.size)


def _bin(risk: FloatArray, wrong: BoolArray) -> ReliabilityBin:
    """Summarise the answers of one bin, of which there is at least one."""
    low, high = wilson_interval(int(wrong.sum()), wrong.size)
    return ReliabilityBin(wrong.size, float(risk.mean()), float(wrong.mean()), low, high)
