"""Summaries for people (a table, one column per run) and for programs (JSON)."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from uasthn_cli.report.metrics import Accuracy, Summary

_NONE = "-"
_STATISTICS = {"mean_m": "mean", "median_m": "median", "p90_m": "90 %"}


@dataclass(frozen=True, slots=True)
class ReportColumn:
    """One run in a report; ``prior`` is what the prior alone gave, if asked for and known."""

    name: str
    version: str
    summary: Summary
    prior: Accuracy | None = None


def report_json(columns: Sequence[ReportColumn]) -> str:
    """Return a list of objects with the same keys for every run; null where there is no figure."""
    return json.dumps([_json_object(column) for column in columns], indent=2, allow_nan=False)


def report_table(columns: Sequence[ReportColumn]) -> list[list[str]]:
    """Return rows of cells, the first being the header: labels, then one column per run.

    A run's column is followed by one for its prior, if there is any.
    """
    header = [""]
    reasons = sorted({reason for column in columns for reason in column.summary.reasons})
    cells: list[dict[str, str]] = []
    for column in columns:
        header.append(column.name)
        cells.append(dict(_run_cells(column.summary, reasons)))
        if column.prior is not None:
            header.append(f"prior of {column.name}")
            cells.append(dict(_accuracy_cells(column.prior, column.summary.tolerance_m)))
    labels = dict.fromkeys(label for run in cells for label in run)
    return [header, *([label, *(run.get(label, _NONE) for run in cells)] for label in labels)]


def _json_object(column: ReportColumn) -> dict[str, Any]:
    """Return the object of one run."""
    return {
        "run": column.name,
        "version": column.version,
        **asdict(column.summary),
        "baseline_prior": asdict(column.prior) if column.prior else None,
    }


def _run_cells(summary: Summary, reasons: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield labels and cells of one run; ``reasons`` are those of all runs."""
    yield "frames", str(summary.frames)
    yield "with estimate", str(summary.with_estimate)
    yield "accepted", str(summary.accepted)
    yield "accepted fraction", _fraction(summary.accepted_fraction)
    for reason in reasons:
        yield f"reason: {reason}", str(summary.reasons.get(reason, 0))
    if summary.accuracy is not None:
        yield from _accuracy_cells(summary.accuracy, summary.tolerance_m)


def _accuracy_cells(accuracy: Accuracy, tolerance_m: float) -> Iterator[tuple[str, str]]:
    """Yield labels and cells of errors against truth."""
    for frames, mace, ce in (
        ("all", accuracy.mace_all, accuracy.ce_all),
        ("accepted", accuracy.mace_accepted, accuracy.ce_accepted),
    ):
        for measure, statistics in (("MACE", mace), ("CE", ce)):
            for name, label in _STATISTICS.items():
                yield f"{measure} {label}, {frames} [m]", _metres(getattr(statistics, name))
    yield f"within {tolerance_m:g} m, all", _fraction(accuracy.within_all)
    yield f"within {tolerance_m:g} m, accepted", _fraction(accuracy.within_accepted)
    if accuracy.without_truth:
        yield "estimates without truth", str(accuracy.without_truth)


def _metres(value: float | None) -> str:
    """Return metres with two decimals."""
    return _NONE if value is None else f"{value:.2f}"


def _fraction(value: float | None) -> str:
    """Return a share with three decimals."""
    return _NONE if value is None else f"{value:.3f}"
