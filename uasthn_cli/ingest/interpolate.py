"""Values at an instant, between the log's samples and never beyond them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uasthn_cli.geometry.rotation import (
    attitude_from_rotation,
    rotation_between,
    rotation_ned_from_body,
)
from uasthn_cli.ingest.clock import Clock
from uasthn_cli.ingest.telemetry import Stamps
from uasthn_cli.ingest.timestamps import duration_words
from uasthn_cli.types import Attitude, FloatArray


class OutsideLogError(ValueError):
    """An instant lies outside the samples, or in a hole that is too long to bridge."""


class AmbiguousTimeError(ValueError):
    """An instant lies in several flights of one log, because its clock was set back."""


@dataclass(frozen=True, slots=True)
class Segment:
    """Samples of one session: ``times_s`` ``(n,)`` strictly rising, ``values`` ``(n, k)``."""

    times_s: FloatArray
    values: FloatArray


@dataclass(frozen=True, slots=True)
class Bracket:
    """The two samples around an instant, and how far from the first to the second it lies."""

    before: FloatArray
    after: FloatArray
    fraction: float


@dataclass(frozen=True, slots=True)
class Track:
    """One kind of sample along the log; ``what`` names it in messages."""

    what: str
    segments: tuple[Segment, ...]

    def bracket(self, time_s: float, max_gap_s: float) -> Bracket:
        """Return the samples before and after an instant.

        Raises:
            OutsideLogError: there is no sample on both sides within ``max_gap_s`` of each other.
            AmbiguousTimeError: several sessions have samples around the instant.
        """
        found = [b for s in self.segments if (b := _bracket(s, time_s, max_gap_s)) is not None]
        if not found:
            raise OutsideLogError(self._explain(time_s, max_gap_s))
        if len(found) > 1:
            raise AmbiguousTimeError(
                f"the log's clock was set back, so this time occurs in {len(found)} of its flights"
            )
        return found[0]

    def spans_s(self) -> list[tuple[float, float]]:
        """Return first and last time of each session."""
        return [(float(s.times_s[0]), float(s.times_s[-1])) for s in self.segments]

    def _explain(self, time_s: float, max_gap_s: float) -> str:
        """Say in one line where an instant lies that has no samples around it."""
        if not self.segments:
            return f"the log has no {self.what} that this clock dates"
        spans = self.spans_s()
        first_s, last_s = min(s for s, _ in spans), max(e for _, e in spans)
        if time_s < first_s:
            return f"{duration_words(first_s - time_s)} before the log's first {self.what}"
        if time_s > last_s:
            return f"{duration_words(time_s - last_s)} after the log's last {self.what}"
        times_s = np.sort(np.concatenate([s.times_s for s in self.segments]))
        index = int(np.searchsorted(times_s, time_s))
        gap_s = times_s[index] - times_s[index - 1]
        gap = duration_words(gap_s)
        return f"in a gap of {gap} between two {self.what}s (at most {max_gap_s:g} s)"


def make_track(what: str, clock: Clock, stamps: Stamps, values: Sequence[FloatArray]) -> Track:
    """Return columns of values ``(n,)`` as a track on a clock, one segment per session."""
    times_s, session = clock.utc_s(stamps), clock.session_of(stamps)
    table = np.column_stack(values)
    segments = []
    for number in range(len(clock.sessions)):
        own = (session == number) & np.isfinite(times_s)
        unique_s, first = np.unique(times_s[own], return_index=True)
        if len(unique_s):
            segments.append(Segment(unique_s, table[own][first]))
    return Track(what, tuple(segments))


def _bracket(segment: Segment, time_s: float, max_gap_s: float) -> Bracket | None:
    times_s, values = segment.times_s, segment.values
    after = int(np.searchsorted(times_s, time_s))
    if after < len(times_s) and times_s[after] == time_s:
        return Bracket(values[after], values[after], 0.0)
    if after in {0, len(times_s)}:
        return None
    gap_s = float(times_s[after] - times_s[after - 1])
    if gap_s > max_gap_s:
        return None
    fraction = float(time_s - times_s[after - 1]) / gap_s
    return Bracket(values[after - 1], values[after], fraction)


def linear(bracket: Bracket) -> FloatArray:
    """Return values ``(k,)`` interpolated linearly."""
    return bracket.before + bracket.fraction * (bracket.after - bracket.before)


def linear_position(bracket: Bracket) -> FloatArray:
    """Return ``(lat_deg, lon_deg, …)`` interpolated linearly, the short way over the date line."""
    before, after = bracket.before.copy(), bracket.after.copy()
    after[1] = before[1] + _wrap_deg(after[1] - before[1])
    result = linear(Bracket(before, after, bracket.fraction))
    result[1] = _wrap_deg(result[1])
    return result


def slerp_attitude(bracket: Bracket) -> Attitude:
    """Return ``(roll, pitch, yaw)`` in radians interpolated along the great circle."""
    before, after = (
        rotation_ned_from_body(Attitude(*values)) for values in (bracket.before, bracket.after)
    )
    return attitude_from_rotation(rotation_between(before, after, bracket.fraction))


def _wrap_deg(angle_deg: float) -> float:
    """Return an angle in -180..180."""
    return float((angle_deg + 180.0) % 360.0 - 180.0)
