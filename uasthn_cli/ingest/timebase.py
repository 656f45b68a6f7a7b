"""Which of a log's two clocks is UTC: decided by evidence, and said why.

The ground station's clock stamps the records; the vehicle's speaks through ``SYSTEM_TIME``. Either
can be wrong by days: a computer without a battery-backed clock goes on from when it was switched
off, and an autopilot without a fix counts from anywhere. The frames' own times are the best
witness.
"""

import itertools
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import Final

import numpy as np

from uasthn_cli.config import TimeBase
from uasthn_cli.errors import FrameTimesError
from uasthn_cli.ingest.clock import Clock, Session, find_sessions
from uasthn_cli.ingest.telemetry import Telemetry
from uasthn_cli.ingest.timestamps import duration_words
from uasthn_cli.types import FloatArray

_log = logging.getLogger(__name__)

_EARLIEST_S = datetime(2005, 1, 1, tzinfo=UTC).timestamp()
_LATEST_S = datetime(2100, 1, 1, tzinfo=UTC).timestamp()
_STEADY_S = 1.0
_AGREEMENT_S = 1.0
_TELLING_SHARE = 0.1
"""Difference between two shares of covered frames that decides between the clocks."""

_NAMES: Final = {TimeBase.RECORD: "record clock", TimeBase.VEHICLE: "vehicle clock"}

Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class TimeBaseChoice:
    """The clock that dates the log: ``base`` is never ``AUTO``, ``why`` is one sentence.

    ``vehicle_offset_s`` is the vehicle's clock minus the ground station's (median over the log),
    None where the log has no ``SYSTEM_TIME``.
    """

    base: TimeBase
    why: str
    vehicle_offset_s: float | None
    clock: Clock


@dataclass(frozen=True, slots=True)
class _Candidate:
    """One clock, what speaks against it (None: nothing), and its share of covered frames."""

    clock: Clock
    complaint: str | None
    share: float | None


@lru_cache(maxsize=1)
def candidate_clocks(telemetry: Telemetry) -> tuple[Clock, ...]:
    """Return the clocks that can date a log: the record clock, and the vehicle's if it has one.

    Those of the last log are kept: a run asks several times.
    """
    sessions = find_sessions(telemetry)
    record = Clock(TimeBase.RECORD, sessions)
    if not any(np.isfinite(session.vehicle_offset_s) for session in sessions):
        return (record,)
    return record, Clock(TimeBase.VEHICLE, sessions)


def log_spans_s(telemetry: Telemetry, clock: Clock) -> list[Span]:
    """Return first and last position time of each session that a clock dates."""
    stamps = telemetry.positions.stamps
    utc_s, session = clock.utc_s(stamps), clock.session_of(stamps)
    spans = []
    for number in range(len(clock.sessions)):
        own = utc_s[(session == number) & np.isfinite(utc_s)]
        if len(own):
            spans.append((float(own.min()), float(own.max())))
    return spans


def covered_share(times_s: FloatArray, spans: Sequence[Span]) -> float:
    """Return the share of times ``(n,)`` that lie in any of the spans."""
    inside = np.zeros(len(times_s), dtype=bool)
    for first_s, last_s in spans:
        inside |= (times_s >= first_s) & (times_s <= last_s)
    return float(inside.mean()) if len(times_s) else 0.0


def choose_time_base(
    telemetry: Telemetry,
    requested: TimeBase = TimeBase.AUTO,
    frame_times_s: FloatArray | None = None,
) -> TimeBaseChoice:
    """Choose the clock that dates a log.

    ``frame_times_s`` ``(n,)`` are UTC times of frames from outside the log (names, EXIF, a table).
    In order of weight: which clock covers them; plausibility of each clock; agreement.

    Raises:
        FrameTimesError: the vehicle's clock is asked for and the log does not have it.
    """
    clocks = candidate_clocks(telemetry)
    if requested is not TimeBase.AUTO:
        chosen = next((clock for clock in clocks if clock.base is requested), None)
        if chosen is None:
            raise FrameTimesError(
                f"{telemetry.path} holds no usable SYSTEM_TIME, so it cannot be dated by the"
                " vehicle's clock; use --time-base record or auto"
            )
        why = f"{_NAMES[requested]}: asked for"
    else:
        candidates = [_examine(telemetry, clock, frame_times_s) for clock in clocks]
        chosen, why = _decide(candidates)
    _log.info("time base: %s", why)
    return TimeBaseChoice(chosen.base, why, _vehicle_minus_record_s(telemetry), chosen)


def _examine(telemetry: Telemetry, clock: Clock, frame_times_s: FloatArray | None) -> _Candidate:
    spans = sorted(log_spans_s(telemetry, clock))
    share = None
    if frame_times_s is not None and len(frame_times_s):
        share = covered_share(frame_times_s, spans)
    return _Candidate(clock, _complaint(clock, spans), share)


def _complaint(clock: Clock, spans: Sequence[Span]) -> str | None:
    """Return what speaks against a clock by itself, from its sorted spans."""
    name = _NAMES[clock.base]
    if not spans:
        return f"the {name} dates no position"
    for time_s in (spans[0][0], spans[-1][1]):
        if not _EARLIEST_S <= time_s <= _LATEST_S:
            return f"the {name} says {_year(time_s)}"
    if any(later[0] < earlier[1] for earlier, later in itertools.pairwise(spans)):
        return f"the {name} was set back, so that flights of this log overlap"
    if clock.base is TimeBase.VEHICLE:
        spread_s = max(_known(session.vehicle_spread_s) for session in clock.sessions)
        if spread_s > _STEADY_S:
            return f"SYSTEM_TIME wanders by {spread_s:.1f} s against the time since boot"
    return None


def _decide(candidates: Sequence[_Candidate]) -> tuple[Clock, str]:
    """Return the better of one or two clocks and the reason."""
    record = candidates[0]
    if len(candidates) == 1:
        return record.clock, "record clock: the log has no usable SYSTEM_TIME"
    vehicle = candidates[1]
    by_frames = _decide_by_frames(record, vehicle)
    if by_frames is not None:
        return by_frames
    if record.complaint and not vehicle.complaint:
        return vehicle.clock, f"vehicle clock: {record.complaint}"
    if vehicle.complaint:
        return record.clock, f"record clock: {vehicle.complaint}"
    apart_s = max(abs(_known(_apart_s(session))) for session in record.clock.sessions)
    if apart_s <= _AGREEMENT_S:
        return vehicle.clock, (
            f"vehicle clock: both agree within {apart_s:.2f} s, and it knows no radio delay"
        )
    _log.warning(
        "the log's two clocks differ by up to %s and the frames do not tell which is right; if"
        " results are off along the track, try --time-base record",
        duration_words(apart_s),
    )
    return vehicle.clock, (
        f"vehicle clock: the two differ by up to {duration_words(apart_s)}, nothing tells which is"
        " right, and this one comes from GPS"
    )


def _decide_by_frames(record: _Candidate, vehicle: _Candidate) -> tuple[Clock, str] | None:
    if record.share is None or vehicle.share is None:
        return None
    if abs(record.share - vehicle.share) <= _TELLING_SHARE:
        return None
    better, worse = (record, vehicle) if record.share > vehicle.share else (vehicle, record)
    why = (
        f"{_NAMES[better.clock.base]}: {better.share:.0%} of the frame times lie in the log by it,"
        f" {worse.share:.0%} by the {_NAMES[worse.clock.base]}"
    )
    return better.clock, why + (f" ({worse.complaint})" if worse.complaint else "")


def _apart_s(session: Session) -> float:
    """Return the vehicle's clock minus the record clock in one session (NaN if unknown)."""
    if not len(session.record_offset_s):
        return float("nan")
    return session.vehicle_offset_s - float(np.median(session.record_offset_s))


def _vehicle_minus_record_s(telemetry: Telemetry) -> float | None:
    times = telemetry.system_times
    if not len(times.stamps):
        return None
    return float(np.median(times.unix_s - times.stamps.record_s))


def _known(value: float) -> float:
    """Return a number, 0 for NaN."""
    return value if np.isfinite(value) else 0.0


def _year(time_s: float) -> str:
    return f"the year {1970 + int(time_s / (365.2425 * 86400))}"
