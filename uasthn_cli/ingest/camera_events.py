"""Which camera message belongs to which frame, when some of either are missing."""

import re
from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from uasthn_cli.ingest.clock import Clock
from uasthn_cli.ingest.telemetry import CameraEvents, IntArray, Stamps
from uasthn_cli.types import FloatArray, FrameFile

_FINE_TOLERANCE_S = 0.3
_WHOLE_SECOND_TOLERANCE_S = 0.55
"""How far a frame's own time strays from its message: by latency, or by EXIF's whole seconds."""

_ZONE_STEP_S = 900.0
"""Time zones differ by multiples of a quarter of an hour."""

_INTERVAL_SHARE = 0.45
_EQUAL_SHARE = 0.1
_COUNTER_TOLERANCE = 0.25
_VOTERS = 500
"""Frames that vote on the common shift; more would cost memory and tell nothing new."""

_STALE_S = 10.0
"""A message whose own time is further than this from its arrival is dated by its arrival."""


def event_times_s(events: CameraEvents, clock: Clock) -> FloatArray:
    """Return UTC ``(n,)`` of exposures on a clock of the log.

    The vehicle's own stamp is used where it has one, freed of radio delay; else the record's.
    """
    boot_s = events.stamps.boot_s.copy()
    session = clock.session_of(events.stamps)
    arrival_s = np.full(len(boot_s), np.nan)
    for number, current in enumerate(clock.sessions):
        own = session == number
        from_unix_s = events.unix_s[own] - current.vehicle_offset_s
        boot_s[own] = np.where(np.isnan(boot_s[own]), from_unix_s, boot_s[own])
        arrival_s[own] = current.boot_s(events.stamps.record_s[own])
    stale = np.abs(boot_s - arrival_s) > _STALE_S
    boot_s[stale] = np.nan
    return clock.utc_s(Stamps(events.stamps.order, events.stamps.record_s, boot_s))


def match_events(
    frames: Sequence[FrameFile],
    stated_times_s: FloatArray,
    events: CameraEvents,
    times_s: FloatArray,
) -> IntArray:
    """Return for each frame ``(f,)`` the index of its event, -1 for none.

    By the names that the camera gave its files, if the messages carry them; else by time: the
    offset between ``stated_times_s`` ``(f,)`` (NaN: unknown) and ``times_s`` ``(n,)`` that matches
    most frames; else by the counters in the frames' names, in the same way; else in order, if
    there are as many frames as events.
    """
    by_name = _match_names(frames, events.file_names)
    if (by_name >= 0).any():
        return by_name
    distinct = _distinct(events, times_s)
    if not len(distinct):
        return by_name
    kept_s, sequence = times_s[distinct], events.sequence[distinct].astype(np.float64)
    numbers = np.array([_last_number(frame.name) for frame in frames])
    if np.isfinite(stated_times_s).any():
        tolerance_s = _time_tolerance_s(stated_times_s, kept_s)
        matched = _match_shifted(stated_times_s, kept_s, tolerance_s, _ZONE_STEP_S)
    elif np.isfinite(numbers).all() and len(np.unique(numbers)) == len(numbers):
        matched = _match_shifted(numbers, sequence, _COUNTER_TOLERANCE, None)
    elif len(frames) == len(distinct):
        matched = np.arange(len(frames))
    else:
        return by_name
    return np.where(matched >= 0, distinct[matched], -1)


def _match_names(frames: Sequence[FrameFile], file_names: Sequence[str]) -> IntArray:
    index = {PurePosixPath(name).name.casefold(): k for k, name in enumerate(file_names) if name}
    names = [PurePosixPath(frame.name).name.casefold() for frame in frames]
    return np.array([index.get(name, -1) for name in names], dtype=np.int64)


def _distinct(events: CameraEvents, times_s: FloatArray) -> IntArray:
    """Return events in order of time, without repeats (several links record a message twice)."""
    order = np.argsort(times_s, kind="stable")
    order = order[np.isfinite(times_s[order])]
    seen: set[tuple[int, float]] = set()
    kept = []
    for index in order:
        key = (int(events.sequence[index]), round(float(times_s[index]), 1))
        if key not in seen:
            seen.add(key)
            kept.append(int(index))
    return np.array(kept, dtype=np.int64)


def _time_tolerance_s(stated_times_s: FloatArray, event_times_s: FloatArray) -> float:
    """Return how far a frame may be from its event, so that neighbours are not mistaken for it."""
    known_s = stated_times_s[np.isfinite(stated_times_s)]
    whole = bool((known_s == np.round(known_s)).all())
    tolerance_s = _WHOLE_SECOND_TOLERANCE_S if whole else _FINE_TOLERANCE_S
    if len(event_times_s) < 2:
        return tolerance_s
    return min(tolerance_s, _INTERVAL_SHARE * float(np.median(np.diff(event_times_s))))


def _match_shifted(
    wanted: FloatArray, offered: FloatArray, tolerance: float, period: float | None
) -> IntArray:
    """Match values up to one common shift; return for each wanted value an index, -1 for none.

    The shift is where most differences ``wanted - offered`` agree within ``tolerance``. Among
    equals the closest agreement wins, and among those (exposures at a steady pace) the shift
    nearest to zero, or to a multiple of ``period``.
    """
    known = wanted[np.isfinite(wanted)]
    sample = known[:: max(1, len(known) // _VOTERS)]
    differences = np.sort((sample[:, None] - offered[None]).ravel())
    ends = np.searchsorted(differences, differences + 2.0 * tolerance, side="right")
    votes = ends - np.arange(len(differences))
    best = np.flatnonzero(votes == votes.max())
    groups = differences[best[:, None] + np.arange(votes.max())]
    centres, spreads = groups.mean(axis=1), groups.std(axis=1)
    centres = centres[spreads <= spreads.min() + _EQUAL_SHARE * tolerance]
    remainder = centres if period is None else centres - period * np.round(centres / period)
    shift = float(centres[np.argmin(np.abs(remainder))])
    return _nearest(wanted - shift, offered, tolerance)


def _nearest(wanted: FloatArray, offered: FloatArray, tolerance: float) -> IntArray:
    """Return for each wanted value the nearest offered one within tolerance, each used once."""
    order = np.argsort(offered, kind="stable")
    after = np.clip(np.searchsorted(offered[order], wanted), 1, max(1, len(offered) - 1))
    neighbours = order[np.stack([after - 1, np.minimum(after, len(offered) - 1)])]
    distances = np.abs(offered[neighbours] - wanted)
    closest = np.argmin(distances, axis=0)
    index, distance = (np.take_along_axis(a, closest[None], 0)[0] for a in (neighbours, distances))
    matched = np.full(len(wanted), -1, dtype=np.int64)
    taken: set[int] = set()
    for row in np.argsort(distance, kind="stable"):
        if distance[row] <= tolerance and int(index[row]) not in taken:
            taken.add(int(index[row]))
            matched[row] = index[row]
    return matched


def _last_number(name: str) -> float:
    """Return the last number in a file's name, NaN if there is none."""
    found = re.findall(r"\d+", PurePosixPath(name).stem)
    return float(found[-1]) if found else float("nan")
