"""Pair frames with camera messages by time: under which shift of the camera's clock do both agree?

Both sides may lack items. Every shift under which many frames meet a message is a hypothesis; its
log-likelihood counts how closely frames meet their messages against chance, what is unpaired on
either side, and that clocks are rather right, or wrong by a time zone, than wrong by anything else.
Exposures at a steady pace fit under many shifts, and then no other hypothesis is refuted.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from uasthn_cli.ingest.telemetry import IntArray
from uasthn_cli.types import FloatArray

_FINE_TOLERANCE_S = 0.3
_WHOLE_SECOND_TOLERANCE_S = 0.55
"""How far a frame's own time strays from its message: by latency, or by EXIF's whole seconds."""

_CLEARANCE_S = 0.1
_WHOLE_SECOND_CLEARANCE_S = 0.35
"""How much nearer its message must be than the next one."""

_INTERVAL_SHARE = 0.45
_LEAST_DEVIATION_S = 0.02
_WHOLE_SECOND_DEVIATION_S = 0.3
_REFUTING_DEVIATIONS, _REFUTING_NATS = 3.5, 7.0
"""What a rival must be worse by. Chosen on ``benchmarks/pairing.py`` with seed 0."""

_VOTERS = 500
"""Frames that vote on the shift; more would cost memory and tell nothing new."""

_HYPOTHESES = 60
_LEAST_VOTES = 0.5
"""Share of the most votes below which a shift is no hypothesis."""

_MANY = 0.8
"""Share of the most frames paired at which a fit tells how closely they may meet."""

_FITS = 5
_LEAST_FOR_DRIFT = 8
_LARGEST_DRIFT = 500e-6
_SIGNIFICANT = 3.0
_LOST_NATS = math.log(0.1)
"""What a frame without message costs, or a message between the frames without a frame."""

_RIGHT_CLOCK, _NEARLY, _ZONE, _ANY = 0.5, 0.25, 0.1, 0.15
"""Prior shares of clocks that are right, set by hand, wrong by a time zone, and by anything."""
_RIGHT_WITHIN_S, _NEARLY_WITHIN_S = 0.4, 60.0
_ZONE_STEP_S, _ZONES = 900.0, 104
_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class TimePairing:
    """One hypothesis: ``index`` ``(f,)`` of each frame's message, -1 for none.

    ``shift_s`` (at the first frame) is what is added to the frames' own times, ``drift`` by how
    much that grows per second, ``residual_s`` what is left, ``deviation_s`` what may be, and
    ``lost`` how many frames, and messages between them, have no partner.
    """

    index: IntArray
    shift_s: float
    drift: float
    residual_s: float
    deviation_s: float = math.inf
    lost: int = 0
    log_likelihood: float = -math.inf

    @property
    def paired(self) -> int:
        """How many frames have a message."""
        return int((self.index >= 0).sum())


def pair_by_time(stated_s: FloatArray, message_s: FloatArray) -> list[TimePairing]:
    """Return hypotheses that contradict one another, the likeliest first; none if nothing meets.

    ``stated_s`` ``(f,)`` are the frames' own times (NaN: unknown), ``message_s`` ``(n,)`` those of
    the messages, rising.
    """
    known = np.isfinite(stated_s)
    if not known.any() or not len(message_s):
        return []
    within = _closeness(stated_s[known], message_s)
    fitted = [
        _fitted(stated_s, message_s, shift_s, within)
        for shift_s in _hypotheses_s(stated_s[known], message_s, within.tolerance_s)
    ]
    fitted = [one for one in fitted if one.paired]
    if not fitted:
        return []
    deviation_s = _deviation_s(fitted, within.is_whole)
    scored = [_scored(one, stated_s, message_s, deviation_s) for one in fitted]
    return _contradicting(sorted(scored, key=lambda one: -one.log_likelihood))


def is_refuted(rival: TimePairing, best: TimePairing) -> bool:
    """Tell whether a pairing is much worse than the best: in what it leaves unpaired, or in time.

    Exposures at a steady pace, of which some are lost, meet nearly as well under any shift by whole
    intervals, and by chance better: only a difference beyond that counts.
    """
    lost = rival.lost + best.lost + 1
    if rival.lost - best.lost >= _REFUTING_DEVIATIONS * math.sqrt(lost):
        return True
    paired = min(rival.paired, best.paired)
    farther = (rival.residual_s**2 - best.residual_s**2) / (2 * best.deviation_s**2)
    return paired * farther >= _REFUTING_NATS + math.sqrt(paired)


def contradict(one: IntArray, other: IntArray) -> bool:
    """Tell whether two pairings give any frame different messages."""
    return bool(((one >= 0) & (other >= 0) & (one != other)).any())


def _nearest(moved_s: FloatArray, message_s: FloatArray, within: "_Closeness") -> IntArray:
    """Return for each time the nearest message ``(f,)``, -1 where that is not clear.

    No other message may be nearly as near, nor another frame to that message.
    """
    around = np.searchsorted(message_s, moved_s)[None] + np.arange(-2, 2)[:, None]
    is_there = (around >= 0) & (around < len(message_s))
    around = np.clip(around, 0, len(message_s) - 1)
    apart_s = np.where(is_there, np.abs(message_s[around] - moved_s), np.inf)
    order = np.argsort(apart_s, axis=0)
    index = np.take_along_axis(around, order, 0)[0]
    first_s, second_s = np.take_along_axis(apart_s, order, 0)[:2]
    rows = np.flatnonzero(first_s <= within.tolerance_s)
    rows = rows[second_s[rows] - first_s[rows] >= within.clearance_s]
    rows = rows[np.lexsort((first_s[rows], index[rows]))]
    claimed, start, claims = np.unique(index[rows], return_index=True, return_counts=True)
    closest = rows[start]
    contested = claims > 1
    rival_s = first_s[rows[np.minimum(start + 1, len(rows) - 1)]] if len(rows) else first_s[rows]
    is_sure = ~(contested & (rival_s - first_s[closest] < within.clearance_s))
    matched = np.full(len(moved_s), -1, dtype=np.int64)
    matched[closest[is_sure]] = claimed[is_sure]
    return matched


@dataclass(frozen=True, slots=True)
class _Closeness:
    """How near a frame's time is to its message, and by how much nearer than to any other."""

    tolerance_s: float
    clearance_s: float
    is_whole: bool


def _closeness(known_s: FloatArray, message_s: FloatArray) -> _Closeness:
    """Return how near frames must be, so that neighbours are not mistaken for one another."""
    is_whole = bool((known_s == np.round(known_s)).all())
    tolerance_s = _WHOLE_SECOND_TOLERANCE_S if is_whole else _FINE_TOLERANCE_S
    if len(message_s) >= 2:
        tolerance_s = min(tolerance_s, _INTERVAL_SHARE * float(np.median(np.diff(message_s))))
    return _Closeness(
        tolerance_s, _WHOLE_SECOND_CLEARANCE_S if is_whole else _CLEARANCE_S, is_whole
    )


def _hypotheses_s(known_s: FloatArray, message_s: FloatArray, tolerance_s: float) -> list[float]:
    """Return the shifts under which most frames meet a message, no two of them alike."""
    sample_s = known_s[:: max(1, len(known_s) // _VOTERS)]
    differences_s = np.sort((message_s[None] - sample_s[:, None]).ravel())
    ends = np.searchsorted(differences_s, differences_s + 2.0 * tolerance_s, side="right")
    votes = ends - np.arange(len(differences_s))
    enough = votes >= max(1.0, _LEAST_VOTES * float(votes.max()))
    starts_s, ends, votes = differences_s[enough], ends[enough], votes[enough]
    firsts = np.flatnonzero(enough)
    found_s: list[float] = []
    while len(found_s) < _HYPOTHESES and votes.max(initial=0) > 0:
        best = int(np.argmax(votes))
        found_s.append(float(np.median(differences_s[firsts[best] : ends[best]])))
        votes = np.where(np.abs(starts_s - starts_s[best]) <= 2.0 * tolerance_s, 0, votes)
    return found_s


def _fitted(
    stated_s: FloatArray, message_s: FloatArray, shift_s: float, within: _Closeness
) -> TimePairing:
    """Return the pairing near a shift, which is refined, and a drift where there is one."""
    first_s, drift = float(np.nanmin(stated_s)), 0.0
    for _ in range(_FITS):
        index = _nearest(stated_s + shift_s + drift * (stated_s - first_s), message_s, within)
        paired = index >= 0
        if not paired.any():
            break
        elapsed_s = stated_s[paired] - first_s
        ahead_s = message_s[index[paired]] - stated_s[paired]
        shift_s, drift = _line(elapsed_s, ahead_s)
        left_s = ahead_s - shift_s - drift * elapsed_s
    residual_s = float(np.sqrt(np.mean(left_s**2))) if paired.any() else math.inf
    return TimePairing(index, shift_s, drift, residual_s)


def _line(elapsed_s: FloatArray, ahead_s: FloatArray) -> tuple[float, float]:
    """Return shift and drift of a clock: no drift that is not significant, nor one no clock has."""
    shift_s, spread_s2 = float(ahead_s.mean()), float(((elapsed_s - elapsed_s.mean()) ** 2).sum())
    if len(elapsed_s) < _LEAST_FOR_DRIFT or spread_s2 == 0.0:
        return shift_s, 0.0
    drift, start_s = np.polyfit(elapsed_s, ahead_s, 1)
    left_s = ahead_s - start_s - drift * elapsed_s
    error = math.sqrt(float((left_s**2).sum()) / (len(left_s) - 2) / spread_s2)
    if _SIGNIFICANT * error < abs(drift) <= _LARGEST_DRIFT:
        return float(start_s), float(drift)
    return shift_s, 0.0


def _deviation_s(fitted: list[TimePairing], is_whole: bool) -> float:
    """Return how closely frames meet their messages: as in the best of the well-voted fits."""
    if is_whole:
        return _WHOLE_SECOND_DEVIATION_S
    most = max(one.paired for one in fitted)
    residuals_s = [one.residual_s for one in fitted if one.paired >= _MANY * most]
    return max(min(residuals_s), _LEAST_DEVIATION_S)


def _scored(
    one: TimePairing, stated_s: FloatArray, message_s: FloatArray, deviation_s: float
) -> TimePairing:
    """Return a pairing with its log-likelihood, against items that have nothing in common."""
    paired = one.index >= 0
    moved_s = stated_s + one.shift_s + one.drift * (stated_s - float(np.nanmin(stated_s)))
    left_s = message_s[one.index[paired]] - moved_s[paired]
    interval_s = float(np.median(np.diff(message_s))) if len(message_s) > 1 else _DAY_S
    interval_s = max(interval_s, deviation_s)
    closeness = -0.5 * float(((left_s / deviation_s) ** 2).sum())
    gain = math.log(interval_s / (deviation_s * math.sqrt(2 * math.pi)))
    first_s, last_s = np.nanmin(moved_s) - deviation_s, np.nanmax(moved_s) + deviation_s
    between = (message_s >= first_s) & (message_s <= last_s)
    lost = int(between.sum() - between[one.index[paired]].sum())
    lost += int(np.isfinite(stated_s).sum()) - one.paired
    likelihood = closeness + gain * one.paired + _LOST_NATS * lost
    likelihood += _log_prior(one.shift_s)
    return replace(one, deviation_s=deviation_s, lost=lost, log_likelihood=likelihood)


def _log_prior(shift_s: float) -> float:
    """Return how likely a clock is wrong by so much; by quarter-hours is likelier than else."""
    from_zone_s = shift_s - _ZONE_STEP_S * round(shift_s / _ZONE_STEP_S)
    return math.log(
        _RIGHT_CLOCK * _density(shift_s, _RIGHT_WITHIN_S)
        + _NEARLY * _density(shift_s, _NEARLY_WITHIN_S)
        + _ZONE / _ZONES * _density(from_zone_s, _RIGHT_WITHIN_S)
        + _ANY / _DAY_S
    )


def _density(offset_s: float, deviation_s: float) -> float:
    exponent = -0.5 * (offset_s / deviation_s) ** 2
    return math.exp(exponent) / (deviation_s * math.sqrt(2 * math.pi))


def _contradicting(ranked: list[TimePairing]) -> list[TimePairing]:
    """Return the best and those that give some frame another message than the best does."""
    return [ranked[0], *(one for one in ranked[1:] if contradict(one.index, ranked[0].index))]
