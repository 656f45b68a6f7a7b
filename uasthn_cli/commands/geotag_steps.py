"""The steps of a run, each kept in a journal: frames alone, the flight, frames again."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Final, TypeVar

from uasthn_cli.commands.console import progress
from uasthn_cli.commands.flight_lines import flight_lines, flight_record
from uasthn_cli.errors import RunInterruptedError
from uasthn_cli.outputs.journal import LOCATED, NEAR_LOOKS, Journal
from uasthn_cli.pipeline import Run
from uasthn_cli.types import Fix, FrameResult, Located, NearLook

T = TypeVar("T")

_UNFUSED: Final = (
    "Every frame stands alone: this estimator scores no places, so the flight cannot settle them"
)


@dataclass(frozen=True, slots=True)
class Journals:
    """What frames gave alone, and what the second look at them gave."""

    located: Journal[Located]
    near: Journal[NearLook]

    def remove(self) -> None:
        """Delete both: the final results are written."""
        self.located.remove()
        self.near.remove()


@dataclass(frozen=True, slots=True)
class Outcome:
    """Results in frame order, what to say and record of the flight, seconds spent on journals."""

    results: list[FrameResult]
    write_s: float
    flight: dict[str, Any] | None = None
    said: list[str] = field(default_factory=list)


@contextmanager
def geotag_journals(out: Path, fingerprint: str) -> Iterator[Journals]:
    """Open the journals; where they hold no frame when the run ends badly, they leave no trace."""
    with (
        Journal(out, fingerprint, LOCATED) as located,
        Journal(out, fingerprint, NEAR_LOOKS) as near,
    ):
        journals = Journals(located, near)
        try:
            yield journals
        except BaseException:
            if not located.finished:
                journals.remove()
                if not any(out.iterdir()):
                    out.rmdir()
            raise


def finish_run(run: Run, journals: Journals, *, fuse: bool) -> Outcome:
    """Compute what the journals do not hold yet.

    Raises:
        RunInterruptedError: Ctrl-C; what is finished stays.
    """
    try:
        return _finish(run, journals, fuse)
    except KeyboardInterrupt as interrupt:
        alone, again = len(journals.located.finished), len(journals.near.finished)
        raise RunInterruptedError(
            f"interrupted after {alone} of {run.frame_count} frames ({again} looked at again),"
            f" which are kept in {journals.located.path.parent}; give the same command again to"
            " go on"
        ) from interrupt


def _finish(run: Run, journals: Journals, fuse: bool) -> Outcome:
    names = [entry.frame.name for entry in run.priors.results]
    kept = frozenset(journals.located.finished)
    write_s = _fill("geo-tagging", len(names), journals.located, run.locate(kept))
    alone = journals.located.finished
    survey = run.survey(alone[name] for name in names) if fuse else None
    if survey is None:
        results = [alone[name].result for name in names]
        has_no_scores = fuse and any(isinstance(result, Fix) for result in results)
        return Outcome(results, write_s, said=[_UNFUSED] if has_no_scores else [])
    seen = frozenset(journals.near.finished)
    again = run.look_again(survey, seen)
    write_s += _fill("looking again", len(survey.frames), journals.near, again)
    results = run.fuse((alone[name] for name in names), survey, journals.near.finished)
    return Outcome(results, write_s, flight_record(survey), flight_lines(run.camera, survey))


def _fill(description: str, total: int, journal: Journal[T], entries: Iterable[T]) -> float:
    """Append what is missing, showing progress; return the seconds spent on writing."""
    write_s = 0.0
    with progress(description, total, done=len(journal.finished)) as advance:
        for entry in entries:
            before_s = perf_counter()
            journal.append(entry)
            write_s += perf_counter() - before_s
            advance(len(journal.finished))
    return write_s
