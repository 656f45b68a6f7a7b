"""Promises that hold for any distribution of errors: the risk of what is accepted, and CE90.

The risk is certified over frames or over flights, taken as independent draws of those that will
be judged. Frames of one flight are not: neighbours see the same ground with the same drift. By
flight, whatever happens within one counts once; see ``docs/calibration.md``.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, betaincinv, rel_entr

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

    ``accepted_needed`` accepted frames would have been enough with as many ``errors``. By flight,
    all three count flights: those with an accepted frame, those with a wrong one among them, and
    how many would have been enough with their ``mean_share`` of wrong ones (None: no number would).
    """

    accepted: int
    errors: int
    accepted_needed: int | None
    mean_share: float | None = None


def binomial_p_value(errors: int, accepted: int, target_risk: float) -> float:
    """Return the chance of so few errors among the accepted if the risk were ``target_risk``.

    Exact under independence: the tail of the binomial distribution, 1 where nothing is accepted.
    """
    return float(bdtr(errors, accepted, target_risk)) if errors < accepted else 1.0


def mean_p_value(shares: FloatArray, target_risk: float) -> float:
    """Return the chance of so low a mean of shares ``(n,)`` if they came from a larger one.

    Shares are independent draws in 0..1 whose true mean is at least ``target_risk``; an upper bound
    for any distribution (Hoeffding 1963, theorem 1, eq. 2.1): ``exp(-n kl(mean, target_risk))``.
    1 where there is none.
    """
    if not shares.size or shares.mean() >= target_risk:
        return 1.0
    return math.exp(-shares.size * _divergence(float(shares.mean()), target_risk))


def flights_needed(
    target_risk: float, confidence_level: float, mean_share: float = 0.0
) -> int | None:
    """Return how many flights certify a risk if their shares have a mean; None if none can."""
    if mean_share >= target_risk:
        return None
    log_level = -math.log(1 - confidence_level)
    return math.ceil(log_level / _divergence(mean_share, target_risk) * (1 - 1e-12))


def flight_shares(accepted: BoolArray, is_error: BoolArray, flight: NDArray[np.intp]) -> FloatArray:
    """Return the share of errors among accepted frames of each flight that has any.

    ``accepted``, ``is_error`` and the number of the ``flight`` are per frame ``(n,)``.
    """
    _, index = np.unique(flight[accepted], return_inverse=True)
    wrong = np.bincount(index, weights=is_error[accepted])
    return np.asarray(wrong / np.bincount(index), dtype=np.float64)


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
    flight: NDArray[np.intp] | None = None,
) -> Certificate | Refusal:
    """Return the laxest threshold under which accepted frames keep a risk, or why there is none.

    Fixed-sequence testing ("learn then test", Angelopoulos et al. 2021, arXiv 2110.01052): for each
    threshold in turn, "more than ``target_risk`` of accepted frames are errors" is tested at level
    ``1 - confidence_level``, until the first time that it is not refuted. To certify a wrong
    threshold, the first wrong one of the sequence must pass; hence, over frames ``(n,)`` to
    certify on, ``P(risk of accepted > target_risk) <= 1 - confidence_level``, whatever the number
    of thresholds. They must have been fixed without looking at these frames.

    With ``flight`` ``(n,)`` flights are the draws, and the risk is the mean, over flights with an
    accepted frame, of the share of errors among their accepted frames.
    """
    passed: Certificate | None = None
    for threshold in thresholds:
        accepted, errors = _counts(risks, is_error, float(threshold))
        if flight is None:
            p_value = binomial_p_value(errors, accepted, target_risk)
        else:
            p_value = mean_p_value(flight_shares(risks <= threshold, is_error, flight), target_risk)
        if p_value > 1 - confidence_level:
            break
        passed = Certificate(float(threshold), accepted, errors)
    if passed is not None:
        return passed
    if flight is not None:
        shares = flight_shares(risks <= thresholds[0], is_error, flight)
        mean_share = float(shares.mean()) if shares.size else 0.0
        needed = flights_needed(target_risk, confidence_level, mean_share)
        return Refusal(shares.size, int((shares > 0).sum()), needed, mean_share)
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


def _divergence(share: float, target: float) -> float:
    """Return the Kullback-Leibler divergence of two coins that show heads with these chances."""
    return float(rel_entr(share, target) + rel_entr(1 - share, 1 - target))


def _counts(risks: FloatArray, is_error: BoolArray, threshold: float) -> tuple[int, int]:
    """Return how many frames a threshold accepts, and how many of these are errors."""
    accepted = risks <= threshold
    return int(accepted.sum()), int((accepted & is_error).sum())
