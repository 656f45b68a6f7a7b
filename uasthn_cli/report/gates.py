"""Gates for cron and CI: what a run must reach."""

from collections.abc import Iterator
from dataclasses import dataclass

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.report.load import RunResults
from uasthn_cli.report.metrics import summarise
from uasthn_cli.report.trust_summary import summarise_trust


@dataclass(frozen=True, slots=True)
class Gates:
    """Limits that a run must keep; None where nothing is asked.

    ``min_accepted`` is the least accepted fraction of all frames, ``max_ce_m`` the largest median
    CE of accepted frames, ``min_within25`` the least share of accepted frames within 25 m,
    ``max_risk`` the largest share of accepted frames beyond the tolerance, ``min_ce90_coverage``
    the least share of accepted frames whose CE is within their predicted CE90.
    """

    min_accepted: float | None = None
    max_ce_m: float | None = None
    min_within25: float | None = None
    max_risk: float | None = None
    min_ce90_coverage: float | None = None


def missed_gates(run: RunResults, gates: Gates, tolerance_m: float = TOLERANCE_M) -> list[str]:
    """Return a phrase for every gate that a run misses; ``tolerance_m`` is for ``max_risk``.

    A gate whose figure does not exist (no truth, no frame, nothing accepted) is missed.
    """
    missed = [*_missed_accuracy(run, gates), *_missed_trust(run, gates, tolerance_m)]
    return [f"{run.name}: {phrase}" for phrase in missed]


def _missed_accuracy(run: RunResults, gates: Gates) -> Iterator[str]:
    """Yield the gates on acceptance and errors that are missed, without the run's name."""
    summary = summarise(run, TOLERANCE_M)
    accuracy = summary.accuracy
    fraction = summary.accepted_fraction
    if gates.min_accepted is not None and not _reaches(fraction, gates.min_accepted):
        found = "of no frames" if fraction is None else f"{fraction:.3f}"
        yield f"accepted fraction {found} is below --min-accepted {gates.min_accepted:g}"
    nothing = _nothing_judged(run)
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


def _missed_trust(run: RunResults, gates: Gates, tolerance_m: float) -> Iterator[str]:
    """Yield the gates on risk and stated uncertainty that are missed, without the run's name."""
    trust = summarise_trust(run, tolerance_m)
    if gates.max_risk is not None:
        risk = trust.accepted_risk if trust else None
        if risk is None:
            yield f"--max-risk cannot be judged, {_nothing_judged(run)}"
        elif risk > gates.max_risk:
            yield (
                f"share of accepted frames beyond {tolerance_m:g} m {risk:.3f}"
                f" exceeds --max-risk {gates.max_risk:g}"
            )
    if gates.min_ce90_coverage is not None:
        coverage = trust.ce90_coverage_accepted if trust else None
        if coverage is None:
            unstated = trust is not None and trust.accepted_risk is not None
            nothing = "no accepted frame states a CE90" if unstated else _nothing_judged(run)
            yield f"--min-ce90-coverage cannot be judged, {nothing}"
        elif not _reaches(coverage, gates.min_ce90_coverage):
            yield (
                f"share of accepted frames within their CE90 {coverage:.3f}"
                f" is below --min-ce90-coverage {gates.min_ce90_coverage:g}"
            )


def _nothing_judged(run: RunResults) -> str:
    """Say why a figure of accepted frames does not exist."""
    return "no accepted frame has a true position" if run.has_truth else "the run has no truth"


def _reaches(value: float | None, least: float) -> bool:
    """Tell whether there is a value and it is large enough."""
    return value is not None and value >= least
