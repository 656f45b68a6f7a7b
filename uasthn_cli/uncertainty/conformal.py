"""Promises that hold for any distribution of errors: the risk of what is accepted, and CE90.

Both take frames as independent draws from the kind of frames that will be judged. Frames of one
flight are not: neighbours see the same ground with the same drift. The numbers of frames that
count are then smaller than those seen; see ``docs/calibration.md`` for what to do about it.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import bdtr, betaincinv

from uasthn_cli.types import BoolArray, FloatArray

LARGEST_MULTIPLE: Final = 4.0


@dataclass(frozen=True, slots=True)
class Certificate:
    """A threshold that keeps the promise, and what it did to the frames it was certified on."""

    threshold: float
    accepted: int
    errors: int


@dataclass(frozen=True, slots=True)
class Refusal:
    """No threshold can be certified: what the first of the sequence did, and what was missing.

    ``accepted_needed`` accepted frames would have been enough with as many ``errors``.
    """

    accepted: int
    errors: int
    accepted_needed: int


def binomial_p_value(errors: int, accepted: int, target_risk: float) -> float:
    """Return the chance of so few errors among the accepted if the risk were ``target_risk``.

    Exact under independence: the tail of the binomial distribution, 1 where nothing is accepted.
    """
    return float(bdtr(errors, accepted, target_risk)) if errors < accepted else 1.0


def risk_upper_bound(errors: int, accepted: int, confidence_level: float) -> float:
    """Return the Clopper-Pearson upper bound of a risk that is looked at once."""
    if errors >= accepted:
        return 1.0
    return float(betaincinv(errors + 1, accepted - errors, confidence_level))


def accepted_needed(target_risk: float, confidence_level: float, errors: int = 0) -> int:
    """Return the least number of accepted frames that certifies a risk with so many errors.

    Without errors that is ``log(1 - confidence_level) / log(1 - target_risk)``, rounded up.
    """
    alpha = 1 - confidence_level
    low, high = errors, errors + 1
    while binomial_p_value(errors, high, target_risk) > alpha:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        if binomial_p_value(errors, middle, target_risk) > alpha:
            low = middle
        else:
            high = middle
    return high


def threshold_sequence(
    risks: FloatArray, is_error: BoolArray, target_risk: float, steps: int = 100
) -> FloatArray:
    """Return thresholds from strict to lax, chosen on frames that will not certify them.

    They are quantiles of ``risks`` ``(n,)``, beginning with the one for which the p-value of these
    frames is least: a sequence ends at its first failure, so it must begin where success is
    likeliest, not where hardly anything is accepted. The last one accepts all of these frames, and
    nothing that looks worse than any of them; and none accepts what by its own account is more than
    ``LARGEST_MULTIPLE`` times as risky as accepted frames may be on average: that only hides among
    many good ones, and the next flight may have fewer of these.
    """
    shares = np.linspace(1 / steps, 1.0, steps)
    thresholds = np.unique(np.quantile(risks, shares, method="higher"))
    modest = thresholds[thresholds <= LARGEST_MULTIPLE * target_risk]
    thresholds = modest if modest.size else thresholds[:1]
    p_values = [
        binomial_p_value(errors, accepted, target_risk)
        for accepted, errors in (_counts(risks, is_error, float(limit)) for limit in thresholds)
    ]
    return thresholds[int(np.argmin(p_values)) :]


def certify(
    risks: FloatArray,
    is_error: BoolArray,
    thresholds: FloatArray,
    target_risk: float,
    confidence_level: float,
) -> Certificate | Refusal:
    """Return the laxest threshold under which accepted frames keep a risk, or why there is none.

    Fixed-sequence testing ("learn then test", Angelopoulos et al. 2021, arXiv 2110.01052): for each
    threshold in turn, "more than ``target_risk`` of accepted frames are errors" is tested at level
    ``1 - confidence_level``, until the first time that it is not refuted. To certify a wrong
    threshold, the first wrong one of the sequence must pass; hence, over frames ``(n,)`` to
    certify on, ``P(risk of accepted > target_risk) <= 1 - confidence_level``, whatever the number
    of thresholds. They must have been fixed without looking at these frames.
    """
    passed: Certificate | None = None
    for threshold in thresholds:
        accepted, errors = _counts(risks, is_error, float(threshold))
        if binomial_p_value(errors, accepted, target_risk) > 1 - confidence_level:
            break
        passed = Certificate(float(threshold), accepted, errors)
    if passed is not None:
        return passed
    accepted, errors = _counts(risks, is_error, float(thresholds[0]))
    return Refusal(accepted, errors, accepted_needed(target_risk, confidence_level, errors))


def conformal_scale(ratios: FloatArray, coverage: float = 0.9) -> float:
    """Return the factor by which radii must grow to cover a share of errors.

    ``ratios`` ``(n,)`` are errors divided by their predicted radii. Split conformal prediction
    (Vovk et al. 2005): the ``ceil((n + 1) * coverage)``-th smallest covers the next frame with at
    least that probability. Infinite where n is too small for that (below 9 for 90 %).
    """
    rank = math.ceil((ratios.size + 1) * coverage * (1 - 1e-12))
    return float(np.sort(ratios)[rank - 1]) if rank <= ratios.size else math.inf


def _counts(risks: FloatArray, is_error: BoolArray, threshold: float) -> tuple[int, int]:
    """Return how many frames a threshold accepts, and how many of these are errors."""
    accepted = risks <= threshold
    return int(accepted.sum()), int((accepted & is_error).sum())
