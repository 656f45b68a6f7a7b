"""From what a log recorded to UTC: one smooth mapping per run of the vehicle's clock.

The vehicle stamps its messages with the time since boot, evenly; the ground station stamps them
when they arrive, late and in bursts. Position and speed of a real flight agree 26 times better by
the vehicle's stamps (0.07 m against 1.9 m per step, rms). So both clocks are used through the time
since boot: ``utc = boot + offset``, where the offset is either what ``SYSTEM_TIME`` says or the
median delay of the ground station's stamps.
"""

from dataclasses import dataclass

import numpy as np

from uasthn_cli.config import TimeBase
from uasthn_cli.ingest.telemetry import IntArray, Stamps, Telemetry
from uasthn_cli.types import FloatArray

_REBOOT_STEP_S = 5.0
"""Time since boot that falls by more than this means a reboot; less is packets out of order."""

_CLOCK_STEP_S = 30.0
_STEP_MESSAGES = 31
"""The record clock was set if its lead over boot time changes by more than ``_CLOCK_STEP_S`` for
half as many messages; radios do not hold packets back for so long."""

_OFFSET_WINDOW_S = 60.0
"""Length over which a median delay is taken: long against bursts, short against drift."""


@dataclass(frozen=True, slots=True)
class Session:
    """One run of both clocks: between two boots, or between two settings of the record clock.

    ``knots_boot_s`` and ``record_offset_s`` ``(k,)`` hold the median of record time minus boot time
    along the session (empty if no message carried boot times). ``vehicle_offset_s`` is the median
    of ``SYSTEM_TIME`` minus boot time and ``vehicle_spread_s`` its range from 5 % to 95 %, both NaN
    without ``SYSTEM_TIME``.
    """

    first_order: int
    knots_boot_s: FloatArray
    record_offset_s: FloatArray
    vehicle_offset_s: float
    vehicle_spread_s: float

    def boot_s(self, record_s: FloatArray) -> FloatArray:
        """Return the vehicle's time since boot at times of the ground station's clock."""
        if not len(self.knots_boot_s):
            return np.full_like(record_s, np.nan)
        first_guess_s = record_s - self.record_offset_s[0]
        boot_s: FloatArray = record_s - np.interp(
            first_guess_s, self.knots_boot_s, self.record_offset_s
        )
        return boot_s

    def record_s(self, boot_s: FloatArray) -> FloatArray:
        """Return times of the ground station's clock, freed of jitter, at times since boot."""
        if not len(self.knots_boot_s):
            return np.full_like(boot_s, np.nan)
        record_s: FloatArray = boot_s + np.interp(boot_s, self.knots_boot_s, self.record_offset_s)
        return record_s


@dataclass(frozen=True, slots=True)
class Clock:
    """UTC by one of the log's two clocks."""

    base: TimeBase
    sessions: tuple[Session, ...]

    def session_of(self, stamps: Stamps) -> IntArray:
        """Return the index of the session ``(n,)`` in which each message was sent."""
        starts = [session.first_order for session in self.sessions]
        return np.asarray(np.searchsorted(starts, stamps.order, side="right") - 1, dtype=np.int64)

    def utc_s(self, stamps: Stamps) -> FloatArray:
        """Return UTC ``(n,)`` of messages; NaN where this clock does not tell it."""
        utc_s = np.full(len(stamps), np.nan)
        index = self.session_of(stamps)
        for number, session in enumerate(self.sessions):
            own = index == number
            if own.any():
                utc_s[own] = self._session_utc_s(session, stamps.record_s[own], stamps.boot_s[own])
        return utc_s

    def _session_utc_s(
        self, session: Session, record_s: FloatArray, boot_s: FloatArray
    ) -> FloatArray:
        boot_s = np.where(np.isnan(boot_s), session.boot_s(record_s), boot_s)
        if self.base is TimeBase.VEHICLE:
            return boot_s + session.vehicle_offset_s
        smooth_s = session.record_s(boot_s)
        return np.where(np.isnan(smooth_s), record_s, smooth_s)


def find_sessions(telemetry: Telemetry) -> tuple[Session, ...]:
    """Split a log where the vehicle rebooted or the record clock was set, and fit each part."""
    families = (telemetry.positions, telemetry.attitudes, telemetry.system_times)
    order = np.concatenate([family.stamps.order for family in families])
    record_s = np.concatenate([family.stamps.record_s for family in families])
    boot_s = np.concatenate([family.stamps.boot_s for family in families])
    has_boot = np.isfinite(boot_s)
    by_order = np.argsort(order[has_boot], kind="stable")
    order, record_s, boot_s = (a[has_boot][by_order] for a in (order, record_s, boot_s))
    starts = _starts(boot_s, record_s)
    firsts = [0, *(int(order[start]) for start in starts[1:])]
    sessions = []
    for number, (start, first) in enumerate(zip(starts, firsts, strict=True)):
        end = starts[number + 1] if number + 1 < len(starts) else len(boot_s)
        limit = firsts[number + 1] if number + 1 < len(firsts) else None
        knots, offsets = _median_offsets(boot_s[start:end], record_s[start:end])
        sessions.append(Session(first, knots, offsets, *_vehicle_offset(telemetry, first, limit)))
    return tuple(sessions)


def _starts(boot_s: FloatArray, record_s: FloatArray) -> list[int]:
    """Return where sessions start, in messages ``(n,)`` in the order of the file."""
    starts = []
    boots = [0, *_reboots(boot_s)]
    for start, end in zip(boots, [*boots[1:], len(boot_s)], strict=True):
        lead_s = record_s[start:end] - boot_s[start:end]
        starts += [start, *(start + step for step in _steps(lead_s))]
    return starts


def _steps(lead_s: FloatArray) -> list[int]:
    """Return where the record clock was set, in its leads ``(n,)`` over boot time."""
    if not len(lead_s) or np.ptp(lead_s) <= _CLOCK_STEP_S:
        return []
    # takes a third of a second to import, and hardly any log needs it
    from scipy.ndimage import median_filter  # noqa: PLC0415

    usual_s = median_filter(lead_s, size=_STEP_MESSAGES, mode="nearest")
    found: list[int] = (np.flatnonzero(np.abs(np.diff(usual_s)) > _CLOCK_STEP_S) + 1).tolist()
    return found


def _reboots(boot_s: FloatArray) -> list[int]:
    """Return where time since boot falls back, in messages ``(n,)`` in the order of the file."""
    found: list[int] = []
    latest_s = -np.inf
    for index, now_s in enumerate(boot_s):
        if now_s < latest_s - _REBOOT_STEP_S:
            found.append(index)
            latest_s = now_s
        else:
            latest_s = max(latest_s, now_s)
    return found


def _median_offsets(boot_s: FloatArray, record_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the median of record minus boot time over windows, and the windows' boot times."""
    if not len(boot_s):
        return np.empty(0), np.empty(0)
    by_boot = np.argsort(boot_s, kind="stable")
    boot_s, offset_s = boot_s[by_boot], (record_s - boot_s)[by_boot]
    windows = max(1, int((boot_s[-1] - boot_s[0]) / _OFFSET_WINDOW_S))
    parts = [part for part in np.array_split(np.arange(len(boot_s)), windows) if len(part)]
    knots = np.array([np.median(boot_s[part]) for part in parts])
    return knots, np.array([np.median(offset_s[part]) for part in parts])


def _vehicle_offset(telemetry: Telemetry, first: int, limit: int | None) -> tuple[float, float]:
    """Return median and spread of ``SYSTEM_TIME`` minus boot time between two records."""
    stamps = telemetry.system_times.stamps
    own = (stamps.order >= first) & (stamps.order < (np.inf if limit is None else limit))
    if not own.any():
        return np.nan, np.nan
    offset_s = telemetry.system_times.unix_s[own] - stamps.boot_s[own]
    low_s, middle_s, high_s = np.percentile(offset_s, (5, 50, 95))
    return float(middle_s), float(high_s - low_s)
