"""A run on a terminal: its journals, its progress bars, Ctrl-C, and what it has to say."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from uasthn_cli.commands.console import progress
from uasthn_cli.commands.flight_lines import flight_lines
from uasthn_cli.errors import RunInterruptedError
from uasthn_cli.outputs.journal import LOCATED, REFINED, Journal
from uasthn_cli.pipeline import GeotagJob, Outcome, Run, drive
from uasthn_cli.types import Fix, Located, RefinedFrame

_UNFUSED: Final = (
    "Every frame stands alone: this estimator scores no places, so the flight cannot settle them"
)


@dataclass(frozen=True, slots=True)
class RunJournals:
    """What frames gave alone, and what refining them gave, on disk."""

    located: Journal[Located]
    refined: Journal[RefinedFrame]

    def remove(self) -> None:
        """Delete both: the final results are written."""
        self.located.remove()
        self.refined.remove()


@contextmanager
def geotag_journals(out: Path, fingerprint: str) -> Iterator[RunJournals]:
    """Open the journals; where they hold no frame when the run ends badly, they leave no trace."""
    with (
        Journal(out, fingerprint, LOCATED) as located,
        Journal(out, fingerprint, REFINED) as refined,
    ):
        journals = RunJournals(located, refined)
        try:
            yield journals
        except BaseException:
            if not located.finished:
                journals.remove()
                if not any(out.iterdir()):
                    out.rmdir()
            raise


def finish_run(run: Run, journals: RunJournals) -> Outcome:
    """Compute what the journals do not hold yet, showing progress.

    Raises:
        RunInterruptedError: Ctrl-C; what is finished stays.
    """
    try:
        return drive(run, journals, progress)
    except KeyboardInterrupt as interrupt:
        alone, refined = len(journals.located.finished), len(journals.refined.finished)
        raise RunInterruptedError(
            f"interrupted after {alone} of {len(run.names)} frames ({refined} refined),"
            f" which are kept in {journals.located.path.parent}; give the same command again to"
            " go on"
        ) from interrupt


def lines_of(job: GeotagJob, outcome: Outcome) -> list[str]:
    """Return what a person should hear of the flight: its constants, or why there is none."""
    if outcome.flight is not None:
        return flight_lines(job.camera, outcome.flight, outcome.poses)
    is_missed = job.config.fuse and any(isinstance(result, Fix) for result in outcome.results)
    return [_UNFUSED] if is_missed and not job.spec.scores_shifts else []
