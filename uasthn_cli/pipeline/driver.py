"""The steps of a run, driven once for everybody: frames alone, the flight, frames refined.

Results hold by frame, not by the order in which frames were finished: whoever works on several at a
time may hand them over as they come.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from time import perf_counter
from typing import Final, Generic, Protocol, TypeVar

from uasthn_cli.fusion.pose_smoother import SmoothedPoses
from uasthn_cli.fusion.spool import ReadOnDemand
from uasthn_cli.outputs.formatting import frame_of
from uasthn_cli.pipeline.flight_stage import FusedFlight
from uasthn_cli.pipeline.run import Run
from uasthn_cli.types import FrameResult, Located, RefinedFrame

T = TypeVar("T")

ALONE: Final = "geo-tagging"
REFINING: Final = "refining"

Progress = Callable[[str, int, int], AbstractContextManager[Callable[[int], None]]]
"""Given a step's name, its number of frames and how many are done already: opens what is told how
many are done after each further one."""


class FrameJournal(Protocol[T]):
    """Where finished frames are kept: an :class:`outputs.journal.Journal`, or memory."""

    @property
    def finished(self) -> Mapping[str, T]:
        """Entries by frame name: those of an earlier run, and those appended since."""

    def append(self, entry: T) -> None:
        """Keep what a frame gave."""


class Journals(Protocol):
    """What frames gave alone, and what refining them gave."""

    @property
    def located(self) -> FrameJournal[Located]:
        """Of each frame alone."""

    @property
    def refined(self) -> FrameJournal[RefinedFrame]:
        """Of each frame of the flight."""


class Memory(Generic[T]):
    """Keeps finished frames for as long as the process lives."""

    def __init__(self, frame_name: Callable[[T], str]) -> None:
        """Start empty; ``frame_name`` tells which frame an entry is of."""
        self._finished: dict[str, T] = {}
        self._frame_name = frame_name

    @property
    def finished(self) -> Mapping[str, T]:
        """Entries by frame name."""
        return self._finished

    def append(self, entry: T) -> None:
        """Keep what a frame gave."""
        self._finished[self._frame_name(entry)] = entry


@dataclass(frozen=True, slots=True)
class MemoryJournals:
    """Nothing survives the process."""

    located: Memory[Located] = field(default_factory=lambda: Memory(_located_name))
    refined: Memory[RefinedFrame] = field(default_factory=lambda: Memory(_refined_name))


@dataclass(frozen=True, slots=True)
class Outcome:
    """A finished run: what frames gave alone, the flight they make, the answers in frame order.

    ``flight`` is None where frames stand alone, because nobody asked for more or they say too
    little. ``computed_frames`` were not taken over from journals; ``write_s`` went into these.
    """

    located: Sequence[Located]
    flight: FusedFlight | None
    results: list[FrameResult]
    computed_frames: int
    write_s: float
    poses: SmoothedPoses | None = None


class _InOrder(ReadOnDemand[T]):
    """Finished frames in the order of their names, each fetched from where it is kept."""

    def __init__(self, names: Sequence[str], finished: Mapping[str, T]) -> None:
        self._names, self._finished = names, finished

    def _entry(self, place: int) -> T:
        return self._finished[self._names[place]]

    def __len__(self) -> int:
        return len(self._names)


def _silent(_: str, __: int, ___: int) -> AbstractContextManager[Callable[[int], None]]:
    """Tell nobody."""
    return nullcontext(lambda _: None)


def drive(run: Run, journals: Journals | None = None, progress: Progress = _silent) -> Outcome:
    """Return the final answer of every frame, computing what ``journals`` do not hold yet.

    Without journals everything is computed and kept in memory. An exception, Ctrl-C among them,
    leaves in the journals what is finished; driving again goes on from there.
    """
    kept = MemoryJournals() if journals is None else journals
    taken_over = frozenset(kept.located.finished)
    entries = run.locate(taken_over)
    write_s = _append_missing(ALONE, len(run.names), kept.located, entries, progress)
    located = _InOrder(run.names, kept.located.finished)
    computed = len(located) - len(taken_over)
    flight = run.fuse_flight(located) if run.fuses else None
    if flight is None:
        return Outcome(located, None, [entry.result for entry in located], computed, write_s)
    refined = run.refine(flight, frozenset(kept.refined.finished))
    write_s += _append_missing(REFINING, len(flight.frames), kept.refined, refined, progress)
    poses = run.settle_poses(flight, kept.refined.finished)
    results = run.place_frames(located, flight, kept.refined.finished, poses)
    return Outcome(located, flight, results, computed, write_s, poses)


def _append_missing(
    step: str, total: int, journal: FrameJournal[T], entries: Iterable[T], progress: Progress
) -> float:
    """Append what is missing, in whatever order it comes; return the seconds spent on that."""
    write_s = 0.0
    with progress(step, total, len(journal.finished)) as advance:
        for entry in entries:
            before_s = perf_counter()
            journal.append(entry)
            write_s += perf_counter() - before_s
            advance(len(journal.finished))
    return write_s


def _located_name(located: Located) -> str:
    return frame_of(located.result).name


def _refined_name(entry: RefinedFrame) -> str:
    return entry.frame.name
