"""Summaries for people (a table, one column per run) and for programs (JSON)."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from uasthn_cli.report.intervals import Interval
from uasthn_cli.report.metrics import (
    LEAST_CHECKPOINTS,
    Accuracy,
    ErrorStatistics,
    HorizontalAccuracy,
    Summary,
)
from uasthn_cli.report.trust_summary import SIGNALS, SignalWorth, TrustSummary

_NONE = "-"
_SHOWN_IF_KNOWN = ("camera CE", "CE90 coverage")
"""Rows that are left out where no run has them: not every truth has camera positions."""
_REASONS_EXPLAINED = 3

INTERVALS_IN_WORDS = (
    "In brackets: 95 % intervals, as if frames were independent. Those of one flight share errors:"
    " for the next flight, figures may lie farther out."
)
"""What is to be said below a table."""

_SINGLE = "single: "
_STATISTICS = {"mean_m": "mean", "rmse_m": "RMSE", "median_m": "median", "p90_m": "90 %"}


@dataclass(frozen=True, slots=True)
class ReportColumn:
    """One run in a report; ``prior`` is what the prior alone gave, if asked for and known.

    ``trust`` is None for a run without truth; ``single`` holds the frames' own answers where the
    run's are fused from several frames.
    """

    name: str
    version: str
    summary: Summary
    prior: Accuracy | None = None
    trust: TrustSummary | None = None
    single: "ReportColumn | None" = None


def report_json(columns: Sequence[ReportColumn]) -> str:
    """Return a list of objects with the same keys for every run; null where there is no figure."""
    return json.dumps([_json_object(column) for column in columns], indent=2, allow_nan=False)


def report_table(columns: Sequence[ReportColumn], with_trust: bool = False) -> list[list[str]]:
    """Return rows of cells, the first being the header: labels, then one column per run.

    A run's column is followed by one for its prior, if there is any. ``with_trust`` adds what the
    stated uncertainties are worth.
    """
    header = [""]
    signals = _stated_signals(columns)
    cells: list[dict[str, str]] = []
    reasons = sorted({reason for column in columns for reason in column.summary.reasons})
    for column in columns:
        header.append(column.name)
        run = dict(_run_cells(column.summary, reasons))
        run |= dict(_coverage_cells(column.trust))
        if with_trust:
            run |= {f"source: {name}": str(n) for name, n in column.summary.sources.items()}
            run |= _trust_cells(column, signals)
        if column.single is not None:
            run |= _single_cells(column.single, signals if with_trust else None)
        cells.append(run)
        if column.prior is not None:
            header.append(f"prior of {column.name}")
            cells.append(dict(_accuracy_cells(column.prior, column.summary.tolerance_m)))
    known = {label for run in cells for label, cell in run.items() if cell != _NONE}
    labels = [
        label
        for label in dict.fromkeys(label for run in cells for label in run)
        if label in known or not label.startswith(_SHOWN_IF_KNOWN)
    ]
    return [header, *([label, *(run.get(label, _NONE) for run in cells)] for label in labels)]


def reasons_in_words(columns: Sequence[ReportColumn]) -> list[str]:
    """Return a line per run and reason, the commonest first, with an example of what was missing.

    At most ``_REASONS_EXPLAINED`` reasons of each run.
    """
    lines = []
    for column in columns:
        reasons, examples = column.summary.reasons, column.summary.examples
        commonest = sorted(examples, key=lambda reason: -reasons[reason])
        for reason in commonest[:_REASONS_EXPLAINED]:
            run = f"{column.name}: " if len(columns) > 1 else ""
            example = examples[reason]
            lines.append(
                f"{run}{reasons[reason]} {reason}, for example {example.frame}: {example.detail}"
            )
    return lines


def _json_object(column: ReportColumn) -> dict[str, Any]:
    """Return the object of one run."""
    single = column.single
    return {
        "run": column.name,
        "version": column.version,
        **asdict(column.summary),
        "baseline_prior": asdict(column.prior) if column.prior else None,
        "trust": asdict(column.trust) if column.trust else None,
        "single": single
        and {**asdict(single.summary), "trust": asdict(single.trust) if single.trust else None},
    }


def _stated_signals(columns: Sequence[ReportColumn]) -> list[str]:
    """Return the signals that any answer of any run has."""
    answers = [one for column in columns for one in (column, column.single) if one is not None]
    return [
        name
        for name in SIGNALS
        if any(one.trust is not None and one.trust.signals[name].answers for one in answers)
    ]


def _run_cells(summary: Summary, reasons: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield labels and cells of one run; ``reasons`` are those of all runs."""
    yield "frames", str(summary.frames)
    yield "with estimate", str(summary.with_estimate)
    yield "accepted", str(summary.accepted)
    yield "accepted fraction", _share(summary, "accepted_fraction")
    for reason in reasons:
        yield f"reason: {reason}", str(summary.reasons.get(reason, 0))
    if summary.accuracy is not None:
        yield from _accuracy_cells(summary.accuracy, summary.tolerance_m)


def _single_cells(single: ReportColumn, signals: Sequence[str] | None) -> Iterator[tuple[str, str]]:
    """Yield what each frame alone would have given; with its trust if ``signals`` are given."""
    accuracy, tolerance_m = single.summary.accuracy, single.summary.tolerance_m
    yield f"{_SINGLE}accepted fraction", _share(single.summary, "accepted_fraction")
    if accuracy is not None:
        for label, cell in _accuracy_cells(accuracy, tolerance_m):
            if label.startswith(("CE median", "CE 90 %", "within")):
                yield f"{_SINGLE}{label}", cell
    if signals is not None:
        for label, cell in _trust_cells(single, signals):
            yield f"{_SINGLE}{label}", cell


def _trust_cells(column: ReportColumn, signals: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield what the stated uncertainties are worth; ``signals`` are those of all runs."""
    trust = column.trust
    if trust is None:
        return
    tolerance = f"{column.summary.tolerance_m:g} m"
    yield f"judged, beyond {tolerance}", f"{trust.beyond_tolerance} of {trust.judged}"
    for name in signals:
        yield f"AUC of {name}", _of_answers(trust.signals[name], "auc", trust.judged)
    for name in signals:
        yield f"AURC by {name}", _of_answers(trust.signals[name], "aurc", trust.judged)
    yield "AURC of the ideal order", _fraction(trust.ideal_aurc)
    yield "calibration error of risk", _fraction(trust.expected_calibration_error)


def _coverage_cells(trust: TrustSummary | None) -> Iterator[tuple[str, str]]:
    """Yield the shares of errors within their stated 90 % radius, of centre and camera."""
    if trust is None:
        return
    for measure, name in (("CE90", "ce90"), ("camera CE90", "camera_ce90")):
        for frames in ("all", "accepted"):
            yield f"{measure} coverage, {frames}", _share(trust, f"{name}_coverage_{frames}")


def _of_answers(worth: SignalWorth, figure: str, judged: int) -> str:
    """Return a figure, and of how many answers it speaks if not of all."""
    value = getattr(worth, figure)
    partly = value is not None and worth.answers < judged
    return _fraction(value) + (f" (of {worth.answers})" if partly else "")


def _accuracy_cells(accuracy: Accuracy, tolerance_m: float) -> Iterator[tuple[str, str]]:
    """Yield labels and cells of errors against truth."""
    for frames, mace, ce, camera in (
        ("all", accuracy.mace_all, accuracy.ce_all, accuracy.camera_ce_all),
        ("accepted", accuracy.mace_accepted, accuracy.ce_accepted, accuracy.camera_ce_accepted),
    ):
        for measure, statistics in (("MACE", mace), ("CE", ce), ("camera CE", camera)):
            for name, label in _STATISTICS.items():
                if measure != "MACE" or name != "rmse_m":
                    yield f"{measure} {label}, {frames} [m]", _metres(statistics, name)
    yield "ASPRS class, accepted [m]", _asprs_class(accuracy.asprs_2023)
    yield f"within {tolerance_m:g} m, all", _share(accuracy, "within_all")
    yield f"within {tolerance_m:g} m, accepted", _share(accuracy, "within_accepted")
    if accuracy.without_truth:
        yield "estimates without truth", str(accuracy.without_truth)


def _asprs_class(found: HorizontalAccuracy) -> str:
    """Return the class of horizontal accuracy, or of how few checkpoints there is none."""
    if found.class_m is None:
        return f"none ({found.checkpoints} of {LEAST_CHECKPOINTS} checkpoints)"
    return f"{found.class_m:.2f} ({found.checkpoints} checkpoints)"


def _metres(statistics: ErrorStatistics, name: str) -> str:
    """Return metres with two decimals, and the interval."""
    return _with_interval(getattr(statistics, name), statistics.intervals.get(name), 2)


def _share(figures: Summary | Accuracy | TrustSummary, name: str) -> str:
    """Return a share with three decimals, and the interval."""
    return _with_interval(getattr(figures, name), figures.intervals.get(name), 3)


def _with_interval(value: float | None, interval: Interval | None, decimals: int) -> str:
    """Return a figure and, in brackets, its interval, unless that leaves everything open."""
    if value is None:
        return _NONE
    figure = f"{value:.{decimals}f}"
    if interval is None or interval == (0.0, None):
        return figure
    low, high = interval
    end = "∞" if high is None else f"{high:.{decimals}f}"
    return f"{figure} ({low:.{decimals}f}–{end})"


def _fraction(value: float | None) -> str:
    """Return a share with three decimals."""
    return _NONE if value is None else f"{value:.3f}"
