"""Which camera message belongs to which frame, when some of either are missing.

In order: the names that the camera gave its files; the frames' own times; the counters of both;
their order. What the evidence does not settle is refused, never guessed.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from uasthn_cli.config import PairBy
from uasthn_cli.ingest.interval_pairing import TimePairing, is_refuted, pair_by_time
from uasthn_cli.ingest.telemetry import CameraEvents, IntArray
from uasthn_cli.ingest.timestamps import duration_words
from uasthn_cli.types import FloatArray, FrameFile

LEAST_SHARE = 0.5
"""Messages that meet fewer of the frames are another camera's, or of another flight."""

_LARGEST_SHIFT_S = 86_400.0
_COUNTS_ON = 20
"""The least first number of a counter that was not set back for this flight: fewer may be lost."""


@dataclass(frozen=True, slots=True)
class Pairing:
    """Which of so many ``messages`` each frame ``(f,)`` has, -1 for none, and what says so."""

    index: IntArray
    messages: int
    by: PairBy
    why: str
    shift_s: float | None = None
    drift: float | None = None
    residual_s: float | None = None

    @property
    def paired(self) -> int:
        """How many frames have a message."""
        return int((self.index >= 0).sum())

    def describe(self, names: Sequence[str]) -> dict[str, Any]:
        """Return what was paired, ready for ``run.json``; ``names`` ``(f,)`` are the frames'."""
        pairs = zip(names, self.index.tolist(), strict=True)
        return {
            "by": self.by.value,
            "clock_shift_s": self.shift_s,
            "clock_drift_ppm": None if self.drift is None else 1e6 * self.drift,
            "residual_s": self.residual_s,
            "frames_without_message": [name for name, message in pairs if message < 0],
            "messages_without_frame": self.messages - self.paired,
        }


class UnpairedError(ValueError):
    """Frames and messages cannot be told to belong together; the message says why."""


def pair_frames(
    frames: Sequence[FrameFile],
    stated_s: FloatArray,
    events: CameraEvents,
    times_s: FloatArray,
    by: PairBy = PairBy.AUTO,
) -> Pairing | None:
    """Return which message each frame has; None where the two have nothing to do with each other.

    ``stated_s`` ``(f,)`` are the frames' own times (NaN: unknown), ``times_s`` ``(n,)`` those of
    the messages. With ``by`` the likeliest pairing by one kind of evidence is taken, however clear.

    Raises:
        UnpairedError: several pairings are as good, or the dates are days apart.
    """
    kept = _distinct(events, times_s)
    if by in {PairBy.AUTO, PairBy.NAME}:
        index = _by_names(frames, events.file_names)
        if (index >= 0).any():
            why = "by the names that the camera gave its files"
            return Pairing(index, len(times_s), PairBy.NAME, why)
        if by is PairBy.NAME:
            raise UnpairedError("no message names a frame's file")
    if not len(kept):
        return None
    is_forced = by is not PairBy.AUTO
    if by is PairBy.TIME or (not is_forced and np.isfinite(stated_s).any()):
        found = _by_time(stated_s, times_s[kept], is_forced)
    elif by is PairBy.ORDER:
        found = _by_order(len(frames), len(kept))
    else:
        found = _by_number(frames, events.sequence[kept], is_forced)
    if found is None:
        return None
    index = np.where(found.index >= 0, kept[found.index], -1)
    return replace(found, index=index, messages=len(times_s))


def _by_names(frames: Sequence[FrameFile], file_names: Sequence[str]) -> IntArray:
    """Return each frame's message by name; frames of one name in several folders have none."""
    index = {PurePosixPath(name).name.casefold(): k for k, name in enumerate(file_names) if name}
    names = [PurePosixPath(frame.name).name.casefold() for frame in frames]
    count = Counter(names)
    found = [index.get(name, -1) if count[name] == 1 else -1 for name in names]
    return np.array(found, dtype=np.int64)


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


def _by_time(stated_s: FloatArray, message_s: FloatArray, is_forced: bool) -> Pairing | None:
    hypotheses = pair_by_time(stated_s, message_s)
    if not hypotheses or len(message_s) < LEAST_SHARE * len(stated_s):
        return None
    best = hypotheses[0]
    if not is_forced:
        _require_clear(hypotheses, len(message_s))
        _require_near(best)
        _require_most(best)
    drift_ppm, residual_s = 1e6 * best.drift, best.residual_s
    why = (
        f"by their own times: {_clock(best.shift_s)}, drift {drift_ppm:+.0f} ppm,"
        f" left {residual_s:.2f} s"
    )
    messages, shift_s, drift = len(message_s), best.shift_s, best.drift
    return Pairing(best.index, messages, PairBy.TIME, why, shift_s, drift, residual_s)


def _require_clear(hypotheses: Sequence[TimePairing], messages: int) -> None:
    """Refuse a pairing that is no likelier than chance, or not clearly better than another.

    One that leaves nothing over on either side is clear: any other needs losses at both ends of the
    flight, and none between.
    """
    best, *rivals = hypotheses
    if len(best.index) == messages == best.paired:
        return
    if best.log_likelihood < 0:
        raise UnpairedError(f"their times meet no better than by chance if {_clock(best.shift_s)}")
    for rival in rivals:
        if not is_refuted(rival, best):
            raise UnpairedError(
                f"{best.paired} frames meet a message if {_clock(best.shift_s)}, {rival.paired} if"
                f" {_clock(rival.shift_s)}: either may be right"
            )


def _require_near(best: TimePairing) -> None:
    if abs(best.shift_s) > _LARGEST_SHIFT_S:
        raise UnpairedError(
            f"frames are dated {duration_words(abs(best.shift_s))}"
            f" {'before' if best.shift_s > 0 else 'after'} the log"
        )


def _require_most(best: TimePairing) -> None:
    if best.paired < LEAST_SHARE * len(best.index):
        raise UnpairedError(f"only {best.paired} of {len(best.index)} frames meet a message")


def _clock(shift_s: float) -> str:
    slow = "slow" if shift_s >= 0 else "fast"
    return f"the frames' clock is {abs(shift_s):.1f} s {slow}"


def _by_order(frames: int, messages: int) -> Pairing:
    if frames != messages:
        raise UnpairedError(f"there are {frames} frames and {messages} messages")
    why = "in their order: there are as many of either"
    return Pairing(np.arange(frames), messages, PairBy.ORDER, why)


def _by_number(frames: Sequence[FrameFile], sequence: IntArray, is_forced: bool) -> Pairing:
    """Pair by counters if they are the same one, or in order if nothing says that any is missing.

    Counters that start near 0 for each flight do not tell which of them begins with 0 and which
    with 1, nor whether frames were numbered anew after some were deleted.
    """
    numbers = np.array([_last_number(frame.name) for frame in frames])
    is_counted = bool(np.isfinite(numbers).all()) and len(np.unique(numbers)) == len(numbers)
    has_gaps = not _is_contiguous(np.sort(sequence)) or (
        is_counted and not _is_contiguous(np.sort(numbers))
    )
    if len(frames) == len(sequence) and not has_gaps and not is_forced:
        return _by_order(len(frames), len(sequence))
    if not is_counted:
        raise UnpairedError(
            f"there are {len(frames)} frames and {len(sequence)} messages, and neither times nor"
            " numbers in the frames' names"
        )
    if is_forced:
        return _shifted_number(numbers, sequence)
    why = "by their numbers, which are those of the messages"
    found = Pairing(_same_number(numbers, sequence), len(sequence), PairBy.NUMBER, why)
    is_new = min(float(numbers.min()), float(sequence.min())) < _COUNTS_ON
    if is_new or found.paired < LEAST_SHARE * len(frames):
        raise UnpairedError(
            f"{len(frames)} frames numbered {numbers.min():.0f} to {numbers.max():.0f} and"
            f" {len(sequence)} messages numbered {sequence.min()} to {sequence.max()}: which are"
            " missing cannot be told"
        )
    return found


def _shifted_number(numbers: FloatArray, sequence: IntArray) -> Pairing:
    """Return the pairing by equal numbers, or from the first of either on if that pairs more."""
    shifts = (0, int(numbers.min()) - int(sequence.min()))
    found = [_same_number(numbers - shift, sequence) for shift in shifts]
    best = int(np.argmax([(index >= 0).sum() for index in found]))
    why = f"by their numbers, a frame's less {shifts[best]} being its message's"
    return Pairing(found[best], len(sequence), PairBy.NUMBER, why)


def _same_number(numbers: FloatArray, sequence: IntArray) -> IntArray:
    place = {int(number): k for k, number in reversed(list(enumerate(sequence.tolist())))}
    return np.array([place.get(int(number), -1) for number in numbers], dtype=np.int64)


def _is_contiguous(ordered: FloatArray | IntArray) -> bool:
    return bool((np.diff(ordered) == 1).all())


def _last_number(name: str) -> float:
    """Return the last number in a file's name, NaN if there is none."""
    found = re.findall(r"\d+", PurePosixPath(name).stem)
    return float(found[-1]) if found else float("nan")
