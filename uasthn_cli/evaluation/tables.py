"""Rows of the paper's tables, drawn from predictions alone: for people, as CSV, as JSON."""

import csv
import io
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np

from uasthn_cli.config import TOLERANCE_M, UeMethod
from uasthn_cli.evaluation.judging import JudgingConfig, judge, refusal
from uasthn_cli.evaluation.metrics import Scores, score
from uasthn_cli.evaluation.predictions import Predictions, Settings

_NONE = "-"
_UNNAMED = ("estimator", "max_offset_m", "version", "device")
"""Settings that tables show in a place of their own, or that change no answer."""


@dataclass(frozen=True, slots=True)
class AccuracyRow:
    """One line of Table I: ``run`` names estimator and settings; ``max_offset_m`` is D_C."""

    run: str
    ue: str
    max_offset_m: float | None
    scores: Scores


@dataclass(frozen=True, slots=True)
class TimingRow:
    """One line of Table II: median milliseconds a frame by method, None where not measured."""

    run: str
    max_offset_m: float | None
    ue_iterations: int | None
    none_ms: float | None
    croptta_ms: float | None
    de_ms: float | None
    croptta_de_ms: float | None


def run_names(settings: Sequence[Settings]) -> list[str]:
    """Return a name for each run: the estimator, and what else tells the runs apart."""
    varying = [
        field.name
        for field in fields(Settings)
        if field.name not in _UNNAMED and len({getattr(one, field.name) for one in settings}) > 1
    ]
    names = []
    taken: Counter[tuple[str, float | None]] = Counter()
    for one in settings:
        parts = [f"{name.replace('_', ' ')} {_plain(getattr(one, name))}" for name in varying]
        name = ", ".join([one.estimator, *parts])
        taken[name, one.max_offset_m] += 1
        number = taken[name, one.max_offset_m]
        names.append(name if number == 1 else f"{name} #{number}")
    return names


def accuracy_rows(
    runs: Sequence[Predictions],
    methods: Sequence[UeMethod],
    config: JudgingConfig,
    tolerance_m: float = TOLERANCE_M,
) -> list[AccuracyRow]:
    """Return Table I: every run by every method that its predictions allow."""
    names = run_names([run.settings for run in runs])
    return [
        AccuracyRow(
            name, method, run.settings.max_offset_m, score(judge(run, method, config), tolerance_m)
        )
        for name, run in zip(names, runs, strict=True)
        for method in methods
        if refusal(run, method) is None
    ]


def timing_rows(runs: Sequence[Predictions]) -> list[TimingRow]:
    """Return Table II."""
    names = run_names([run.settings for run in runs])
    return [_timing_row(name, run) for name, run in zip(names, runs, strict=True)]


def accuracy_table(rows: Sequence[AccuracyRow], tolerance_m: float) -> list[list[str]]:
    """Return cells, the header first."""
    header = ["run", "UE", "D_C m", "samples", "MACE m", "CE m", "accepted"]
    lines = []
    for row in rows:
        scores = row.scores
        cells = [row.run, row.ue, _plain(row.max_offset_m), str(scores.samples)]
        cells += [_number(scores.mace_m, 2), _number(scores.ce_m, 2)]
        cells += [_number(scores.accepted_fraction, 3), _number(scores.accepted_within, 3)]
        lines.append([*cells, _number(scores.auc, 3)])
    return [[*header, f"of these ≤ {tolerance_m:g} m", "AUC"], *lines]


def timing_table(rows: Sequence[TimingRow]) -> list[list[str]]:
    """Return cells, the header first."""
    header = ["run", "D_C m", "early stopping", "w/o UE ms", "CropTTA ms", "DE ms", "CropTTA+DE ms"]
    lines = []
    for row in rows:
        stop = "no" if row.ue_iterations is None else f"after {row.ue_iterations}"
        times = (row.none_ms, row.croptta_ms, row.de_ms, row.croptta_de_ms)
        cells = [row.run, _plain(row.max_offset_m), stop]
        lines.append([*cells, *(_number(time, 1) for time in times)])
    return [header, *lines]


def accuracy_csv(rows: Sequence[AccuracyRow]) -> str:
    """Return one line per row; what there is none of stays empty."""
    return rows_csv([_flat(row) for row in rows])


def timing_csv(rows: Sequence[TimingRow]) -> str:
    """Return one line per row; what there is none of stays empty."""
    return rows_csv([asdict(row) for row in rows])


def evaluation_json(
    accuracy: Sequence[AccuracyRow], timing: Sequence[TimingRow], runs: Sequence[Predictions]
) -> str:
    """Return everything as one JSON object."""
    content = {
        "accuracy": [_flat(row) for row in accuracy],
        "timing": [asdict(row) for row in timing],
        "runs": [asdict(run.settings) for run in runs],
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _timing_row(name: str, run: Predictions) -> TimingRow:
    whole_s, views_s, members_s = run.seconds.T
    has_views, has_members = run.views > 1, run.members > 1
    return TimingRow(
        run=name,
        max_offset_m=run.settings.max_offset_m,
        ue_iterations=run.settings.ue_iterations,
        none_ms=_median_ms(whole_s),
        croptta_ms=_median_ms(views_s) if has_views else None,
        de_ms=_median_ms(whole_s + members_s) if has_members else None,
        croptta_de_ms=_median_ms(views_s + members_s) if has_views and has_members else None,
    )


def _median_ms(seconds: np.ndarray) -> float | None:
    measured = seconds[np.isfinite(seconds)]
    return 1000.0 * float(np.median(measured)) if measured.size else None


def _flat(row: AccuracyRow) -> dict[str, object]:
    named = {"run": row.run, "ue": row.ue, "max_offset_m": row.max_offset_m}
    return named | asdict(row.scores)


def rows_csv(rows: Sequence[dict[str, object]]) -> str:
    """Return dictionaries of the same keys as CSV; None stays empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: "" if value is None else value for key, value in row.items()})
    return text.getvalue()


def _number(value: float | None, digits: int) -> str:
    return _NONE if value is None else f"{value:.{digits}f}"


def _plain(value: object) -> str:
    if value is None:
        return _NONE
    if isinstance(value, tuple):
        return "+".join(map(str, value)) or _NONE
    return f"{value:g}" if isinstance(value, float) else str(value)
