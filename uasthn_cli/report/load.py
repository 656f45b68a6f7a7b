"""Read a results folder back: ``frames.csv`` and ``run.json``."""

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from uasthn_cli.errors import ResultsError

_REQUIRED: Final = ("frame", "accepted", "reason", "lat", "lon", "prior_lat", "prior_lon")
_ACCEPTED: Final = {"true": True, "false": False}


@dataclass(frozen=True, slots=True)
class FrameRow:
    """What a report needs of one row; errors in metres, NaN where there is none.

    ``ce_m`` and ``mace_m`` compare the estimate with truth, ``prior_ce_m`` the prior's camera
    position with the true one.
    """

    frame: str
    has_estimate: bool
    has_prior: bool
    accepted: bool
    reason: str
    ce_m: float
    mace_m: float
    prior_ce_m: float


@dataclass(frozen=True, slots=True)
class RunResults:
    """One finished run: its folder as named by the user, the program's version, its frames."""

    name: str
    version: str
    rows: tuple[FrameRow, ...]
    has_truth: bool
    has_prior_error: bool


def load_run(folder: Path) -> RunResults:
    """Read a results folder.

    Raises:
        ResultsError: it is missing, unfinished, or its table lacks columns or holds bad cells.
    """
    record = _read_record(folder)
    path = folder / "frames.csv"
    try:
        with path.open(encoding="utf-8", newline="") as handle:
            reader = csv.DictReader(handle)
            columns = reader.fieldnames or ()
            missing = [name for name in _REQUIRED if name not in columns]
            if missing:
                raise ResultsError(f"{path}: column {', '.join(missing)} is missing")
            rows = tuple(_parse(row, f"{path}:{reader.line_num}") for row in reader)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ResultsError(f"{path}: not a CSV table in UTF-8: {error}") from error
    expected = record["counts"]["frames"]
    if len(rows) != expected:
        raise ResultsError(
            f"{path}: holds {len(rows)} frames where run.json counts {expected}:"
            " the table was cut or changed, run `uasthn geotag` again"
        )
    return RunResults(
        name=str(folder),
        version=str(record["version"]),
        rows=rows,
        has_truth="ce_m" in columns and "mace_m" in columns,
        has_prior_error="prior_ce_m" in columns,
    )


def _read_record(folder: Path) -> Mapping[str, Any]:
    """Read ``run.json``, whose presence marks a finished run."""
    path = folder / "run.json"
    if not folder.is_dir():
        raise ResultsError(f"{folder}: no such results folder")
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ResultsError(
            f"{folder}: no run.json, so no finished run: run `uasthn geotag --out {folder}` (again)"
        ) from error
    except OSError as error:
        raise ResultsError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise ResultsError(f"{path}: not JSON: {error}") from error
    try:
        complete = isinstance(record["counts"]["frames"], int) and "version" in record
    except (KeyError, TypeError):
        complete = False
    if not complete:
        raise ResultsError(f"{path}: not the record of a run (version or counts are missing)")
    checked: Mapping[str, Any] = record
    return checked


def _parse(row: Mapping[str, str | None], where: str) -> FrameRow:
    """Read one row; ``where`` names file and line in errors."""
    accepted = row["accepted"] or ""
    if accepted not in _ACCEPTED:
        raise ResultsError(f"{where}: accepted is {accepted!r}, expected true or false")
    return FrameRow(
        frame=row["frame"] or "",
        has_estimate=bool(row["lat"] and row["lon"]),
        has_prior=bool(row["prior_lat"] and row["prior_lon"]),
        accepted=_ACCEPTED[accepted],
        reason=row["reason"] or "",
        ce_m=_metres(row, "ce_m", where),
        mace_m=_metres(row, "mace_m", where),
        prior_ce_m=_metres(row, "prior_ce_m", where),
    )


def _metres(row: Mapping[str, str | None], column: str, where: str) -> float:
    """Read an error in metres; NaN for an empty cell or an absent column."""
    cell = row.get(column)
    if not cell:
        return math.nan
    try:
        return float(cell)
    except ValueError as error:
        raise ResultsError(f"{where}: {column} is {cell!r}, expected metres") from error
