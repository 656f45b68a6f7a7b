"""Read a results folder back: ``frames.csv`` and ``run.json``."""

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from uasthn_cli.errors import ResultsError
from uasthn_cli.report.rows import FrameRow, parse_row

_REQUIRED: Final = ("frame", "accepted", "reason", "lat", "lon", "prior_lat", "prior_lon")


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
            rows = tuple(parse_row(row, f"{path}:{reader.line_num}") for row in reader)
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


def single_frame_run(run: RunResults) -> RunResults | None:
    """Return the run as it would be without fusion over frames; None where nothing was fused."""
    singles = tuple(row.single for row in run.rows if row.single is not None)
    if not singles:
        return None
    return replace(run, name=f"{run.name}, single frames", rows=singles)


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
