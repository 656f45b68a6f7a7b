"""Gates for cron and CI: what a run must reach."""

from collections.abc import Iterator
from dataclasses import dataclass

from uasthn_cli.report.load import RunResults
from uasthn_cli.report.metrics import DEFAULT_TOLERANCE_M, summarise


@dataclass(frozen=True, slots=True)
class Gates:
    """Limits that a run must keep; None where nothing is asked.

    ``min_accepted`` is the least accepted fraction of all frames, ``max_ce_m`` the largest median
    CE of accepted frames, ``min_within25`` the least share of accepted frames within 25 m.
    """

    min_accepted: float | None = None
    max_ce_m: float | None = None
    min_within25: float | None = None


def missed_gates(run: RunResults, gates: Gates) -> list[str]:
    """Return a phrase for every gate that a run misses.

    A gate whose figure does not exist (no truth, no frame, nothing accepted) is missed.
    """
    return [f"{run.name}: {phrase}" for phrase in _missed(run, gates)]


def _missed(run: RunResults, gates: Gates) -> Iterator[str]:
    """Yield what is missed, without the run's name."""
    summary = summarise(run, DEFAULT_TOLERANCE_M)
    accuracy = summary.accuracy
    fraction = summary.accepted_fraction
    if gates.min_accepted is not None and not _reaches(fraction, gates.min_accepted):
        found = "of no frames" if fraction is None else f"{fraction:.3f}"
        yield f"accepted fraction {found} is below --min-accepted {gates.min_accepted:g}"
    nothing = "no accepted frame has a true position" if accuracy else "the run has no truth"
    if gates.max_ce_m is not None:
        median_m = accuracy.ce_accepted.median_m if accuracy else None
        if median_m is None:
            yield f"--max-ce cannot be judged, {nothing}"
        elif median_m > gates.max_ce_m:
            yield (
                f"median CE of accepted frames {median_m:.2f} m exceeds --max-ce {gates.max_ce_m:g}"
            )
    if gates.min_within25 is not None:
        share = accuracy.within_accepted if accuracy else None
        if share is None:
            yield f"--min-within25 cannot be judged, {nothing}"
        elif not _reaches(share, gates.min_within25):
            yield (
                f"share of accepted frames within 25 m {share:.3f}"
                f" is below --min-within25 {gates.min_within25:g}"
            )


def _reaches(value: float | None, least: float) -> bool:
    """Tell whether there is a value and it is large enough."""
    return value is not None and value >= least
