"""What a frame and those around it say alone of the flight's answer, in words."""

from collections.abc import Sequence

import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.pipeline.flight_stage import FlightFrame
from uasthn_cli.types import FloatArray

_RUNS_NAMED = 2


def neighbours_in_words(
    frames: Sequence[FlightFrame], apart_m: FloatArray, near: range, index: int
) -> str:
    """Return in one line which frames say something else than the flight, and by how much.

    ``frames`` ``(T,)`` are the flight's in order of time, ``apart_m`` ``(T,)`` how far each one's
    own answer lies from the flight's (NaN: it has none); ``near`` are those that count for frame
    ``index``.
    """
    against = [k for k in near if apart_m[k] > TOLERANCE_M]
    agreeing = [frames[k].single for k in near if apart_m[k] <= TOLERANCE_M]
    sure = [single.trust.confidence for single in agreeing if single is not None]
    silent = len(near) - len(against) - len(agreeing)
    parts = []
    if against:
        runs = _runs_in_words(frames, apart_m, against)
        parts.append(f"{_counted(len(against), 'say')} otherwise ({runs})")
    if silent:
        parts.append(f"{_counted(silent, 'say')} nothing")
    if sure:
        parts.append(f"{_counted(len(sure), 'agree')}, {np.mean(sure):.2f} sure on average")
    return f"{_own_words(float(apart_m[index]))}; of {len(near)} near frames {', '.join(parts)}"


def _counted(count: int, verb: str) -> str:
    return f"{count} {verb}{'s' if count == 1 else ''}"


def _own_words(distance_m: float) -> str:
    """Return what a frame alone says of the flight's answer, from how far its own lies from it."""
    if np.isnan(distance_m):
        return "alone it says nothing"
    if distance_m <= TOLERANCE_M:
        return f"alone it agrees to {distance_m:.0f} m"
    return f"alone it says otherwise by {distance_m:.0f} m"


def _runs_in_words(
    frames: Sequence[FlightFrame], apart_m: FloatArray, against: Sequence[int]
) -> str:
    """Name the longest runs of consecutive frames and the median of how far off they say it is."""
    breaks = np.flatnonzero(np.diff(against) > 1) + 1
    runs = sorted(np.split(np.asarray(against), breaks), key=len, reverse=True)
    named = []
    for run in runs[:_RUNS_NAMED]:
        first, last = (frames[run[k]].prior.frame.name for k in (0, -1))
        names = first if len(run) == 1 else f"{first} … {last}"
        named.append(f"{names} by {np.median(apart_m[run]):.0f} m")
    more = sum(len(run) for run in runs[_RUNS_NAMED:])
    return ", ".join(named) + (f", and {more} more" if more else "")
