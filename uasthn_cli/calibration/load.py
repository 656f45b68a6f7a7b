"""Results folders in, answers with known errors out."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from uasthn_cli.calibration.answers import Answers, RunAnswers, joined
from uasthn_cli.errors import CalibrationError, ResultsError
from uasthn_cli.fusion.offsets import ce90_of, map_variance_m2
from uasthn_cli.report.load import load_run
from uasthn_cli.types import BoolArray, FloatArray, Reason
from uasthn_cli.uncertainty.calibration import AnswerKind
from uasthn_cli.uncertainty.risk_model import SIGNALS

SINGLE_PREFIX: Final = "single_"
"""Begins the columns of the single-frame answer in a run whose main answer is fused."""

_UNSTATED: Final = "a kind that it does not state"

_NEVER_ACCEPTED: Final = (
    *(Reason.DEGENERATE_HOMOGRAPHY, Reason.IMPLAUSIBLE_SCALE, Reason.UNSUPPORTED),
    *(Reason.OFF_MAP, Reason.TEXTURELESS),
)
"""Reasons that stand whatever the risk."""


@dataclass(frozen=True, slots=True)
class GpsStretch:
    """When the logged GPS was good, in UTC seconds, both ends included; by default always."""

    start_utc_s: float = -math.inf
    end_utc_s: float = math.inf


def load_answers(folders: Sequence[Path], gps: GpsStretch | None = None) -> RunAnswers:
    """Read finished runs; errors are ``ce_m``, or with ``gps`` the distance to the logged position.

    A frame whose answer nothing judges has no part in it; one without an answer stays, as never
    accepted.

    Raises:
        ResultsError: a folder holds no finished run, or its table a bad cell, or is given twice.
        CalibrationError: a run has no truth, none of its frames lies in the stretch, or its answers
            are of another kind than those before it.
    """
    singles, fused = [], []
    kind = None
    seen: set[Path] = set()
    for flight, folder in enumerate(folders):
        if folder.resolve() in seen:
            raise ResultsError(f"{folder}: given twice: its frames would count twice")
        seen.add(folder.resolve())
        table = _Table(folder, flight, gps)
        if flight and table.kind != kind:
            raise CalibrationError(
                f"{folder}: its answers are of {table.kind or _UNSTATED}, those of {folders[0]} of"
                f" {kind or _UNSTATED}: calibrate one kind at a time"
            )
        kind = table.kind
        if any(name.startswith(SINGLE_PREFIX) for name in table.cells.columns):
            singles.append(table.answers("single", SINGLE_PREFIX))
            fused.append(table.answers("fused", ""))
        else:
            singles.append(table.answers("single", ""))
    return RunAnswers(joined(singles), joined(fused) if fused else None, kind)


class _Table:
    """One ``frames.csv`` as text, cell by cell, with what ``run.json`` says about it."""

    def __init__(self, folder: Path, flight: int, gps: GpsStretch | None) -> None:
        load_run(folder)  # refuses what is missing, unfinished or cut
        self.path = folder / "frames.csv"
        self.cells = pd.read_csv(self.path, dtype=str, keep_default_na=False)
        self._record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        self._flight, self._gps = flight, gps
        if gps is not None:
            self.cells = self.cells[self._in_stretch(gps)]
        if self.cells.empty:
            raise CalibrationError(f"{self.path}: no frame in the stretch given by --from-gps")

    def answers(self, kind: str, prefix: str) -> Answers:
        """Return the answers whose columns begin with a prefix, without those nothing judges.

        A frame of a fused run whose main answer is its own (``source`` is ``fix``) belongs to the
        single-frame answers only.
        """
        error_m = self._error_m(prefix)
        has_answer = self._has_answer(prefix)
        impossible = self._text(f"{prefix}reason").isin(_NEVER_ACCEPTED).to_numpy()
        answers = Answers(
            flight=np.full(len(self.cells), self._flight, dtype=np.intp),
            error_m=np.where(has_answer, error_m, np.nan),
            acceptable=has_answer & ~impossible,
            ce90_m=self._own_ce90_m(prefix, kind),
            map_ce90_m=np.full(len(self.cells), self._map_ce90_m()),
            signals={name: self._numbers(prefix + name) for name in SIGNALS},
        )
        judged = np.isfinite(error_m) | ~has_answer
        if kind == "fused":
            judged &= (self._text("source") != "fix").to_numpy()
        return answers.rows(judged)

    @property
    def kind(self) -> AnswerKind | None:
        """Whose answers these are; None of runs of earlier versions."""
        notes = self._record.get("notes")
        told = notes.get("uncertainty") if isinstance(notes, dict) else None
        if not isinstance(told, dict):
            return None
        return AnswerKind(str(notes.get("estimator")), str(told.get("method")))

    def _error_m(self, prefix: str) -> FloatArray:
        name = f"{prefix}ce_m" if self._gps is None else f"{prefix}offset_m"
        if name not in self.cells.columns:
            remedy = (
                "run `uasthn geotag` with --truth, or say with --from-gps where GPS was good"
                if self._gps is None
                else "run `uasthn geotag` again with this version"
            )
            raise CalibrationError(f"{self.path}: no column {name}: {remedy}")
        return self._numbers(name)

    def _has_answer(self, prefix: str) -> BoolArray:
        """Tell which rows hold an answer; a position carried over from the log is none."""
        names = (f"{prefix}center_lat", f"{prefix}lat", f"{prefix}ce_m")
        filled = [(self._text(name) != "").to_numpy() for name in names]
        has_answer: BoolArray = np.any(filled, axis=0)
        return has_answer if prefix else has_answer & (self._text("source") != "prior").to_numpy()

    def _in_stretch(self, gps: GpsStretch) -> BoolArray:
        """Tell which rows were taken while GPS was good; an undated one only if it always was."""
        if gps == GpsStretch():
            return np.ones(len(self.cells), dtype=np.bool_)
        moments = pd.to_datetime(
            self._text("time_utc"), utc=True, format="ISO8601", errors="coerce"
        )
        since = (moments - pd.Timestamp(0, tz="UTC")).dt.total_seconds().to_numpy(np.float64)
        return (since >= gps.start_utc_s) & (since <= gps.end_utc_s)

    def _own_ce90_m(self, prefix: str, kind: str) -> FloatArray:
        """Return the radii without what the run's calibration and map error made of them."""
        beyond_map2 = self._numbers(f"{prefix}ce90_m") ** 2 - self._map_ce90_m() ** 2
        return np.sqrt(np.maximum(beyond_map2, 0.0)) / self._applied_ce90_scale(kind)

    def _map_ce90_m(self) -> float:
        """Return the 90 % radius of what the map leaves open, which the run allowed for."""
        notes = self._record.get("notes")
        pixel_m = notes.get("map_pixel_m") if isinstance(notes, dict) else None
        arguments = self._record.get("arguments")
        config = arguments.get("config") if isinstance(arguments, dict) else None
        map_error_m = config.get("map_error_m") if isinstance(config, dict) else None
        variance_m2 = map_variance_m2(float(map_error_m or 0.0), float(pixel_m or 0.0))
        return ce90_of(np.eye(2) * variance_m2)

    def _applied_ce90_scale(self, kind: str) -> float:
        """Return what ``ce90_m`` was multiplied by already: the scale of the run's calibration."""
        used = self._record.get("calibration")
        judgement = used.get(kind) if isinstance(used, dict) else None
        scale = judgement.get("ce90_scale") if isinstance(judgement, dict) else 1.0
        if not isinstance(scale, int | float) or not 0 < scale < math.inf:
            raise ResultsError(
                f"{self.path.with_name('run.json')}: calibration: {kind}: ce90_scale is {scale!r},"
                " expected a number above 0"
            )
        return float(scale)

    def _text(self, column: str) -> "pd.Series[str]":
        """Return the cells of a column; empty where it is absent."""
        if column in self.cells.columns:
            return self.cells[column]
        return pd.Series("", index=self.cells.index, dtype=str)

    def _numbers(self, column: str) -> FloatArray:
        """Return a column of numbers ``(n,)``; NaN for empty cells or an absent column."""
        text = self._text(column)
        numbers = pd.to_numeric(text, errors="coerce").to_numpy(np.float64)
        bad = np.flatnonzero(np.isnan(numbers) & (text != "").to_numpy())
        if bad.size:
            line = int(text.index[bad[0]]) + 2
            raise ResultsError(
                f"{self.path}:{line}: {column} is {text.iloc[bad[0]]!r}, expected a number"
            )
        return numbers
