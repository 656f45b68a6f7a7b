"""The files of ``uasthn evaluate``: tables as CSV and JSON, figures as PNG and SVG."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import click

from uasthn_cli.config import UeMethod
from uasthn_cli.errors import OutputError, PredictionsError
from uasthn_cli.evaluation.judging import JudgingConfig, judge, refusal
from uasthn_cli.evaluation.predictions import Predictions
from uasthn_cli.evaluation.stress import StressRow
from uasthn_cli.evaluation.tables import (
    accuracy_csv,
    accuracy_rows,
    accuracy_table,
    evaluation_json,
    rows_csv,
    run_names,
    timing_csv,
    timing_rows,
    timing_table,
)
from uasthn_cli.outputs.atomic import write_files

_TABLES = ("accuracy.csv", "timing.csv", "evaluation.json")
_STRESS = ("stress.csv", "stress.json")
_FORMATS = ("png", "svg")


@dataclass(frozen=True, slots=True)
class EvaluationFolder:
    """Where everything goes; what is there is replaced only with ``overwrite``."""

    folder: Path
    overwrite: bool
    with_figures: bool

    def made(self) -> Path:
        """Return the folder, made if it was not there.

        Raises:
            OutputError: it cannot be made.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot make {self.folder}: {error.strerror or error}") from error
        return self.folder

    def write(
        self,
        runs: Sequence[Predictions],
        methods: "tuple[UeMethod, ...] | None",
        judging: JudgingConfig,
        tolerance_m: float,
    ) -> list[list[list[str]]]:
        """Write tables and figures of runs, and return the tables to print.

        Raises:
            PredictionsError: a method was asked for that no run allows.
            OutputError: a file cannot be written.
        """
        chosen = methods or tuple(method for method in UeMethod if _is_possible(runs, method))
        for method in methods or ():
            if not _is_possible(runs, method):
                raise PredictionsError(str(refusal(runs[0], method)))
        accuracy = accuracy_rows(runs, chosen, judging, tolerance_m)
        timing = timing_rows(runs)
        texts = (
            accuracy_csv(accuracy),
            timing_csv(timing),
            evaluation_json(accuracy, timing, runs),
        )
        files = [
            (self.folder / name, text.encode()) for name, text in zip(_TABLES, texts, strict=True)
        ]
        if self.with_figures:
            files += self._figures(runs, chosen, judging, tolerance_m)
        self.made()
        write_files(files)
        return [accuracy_table(accuracy, tolerance_m), timing_table(timing)]

    def write_stress(self, rows: Sequence[StressRow]) -> list[list[str]]:
        """Write what became of stressed flights, and return the table to print.

        Raises:
            OutputError: a file is there already, or cannot be written.
        """
        paths = [self.made() / name for name in _STRESS]
        existing = [path for path in paths if path.exists()]
        if existing and not self.overwrite:
            raise OutputError(f"{existing[0]} exists already: --overwrite replaces it")
        plain = [asdict(row) for row in rows]
        content = json.dumps(plain, indent=2, allow_nan=False) + "\n"
        write_files([(paths[0], rows_csv(plain).encode()), (paths[1], content.encode())])
        header = ["flight", "category", "severity", "frames", "rejected", "accepted within"]
        lines = [
            [
                row.flight,
                row.category,
                f"{row.severity:g}",
                str(row.frames),
                f"{row.rejected_fraction:.2f}",
                "-" if row.accepted_within is None else f"{row.accepted_within:.2f}",
            ]
            for row in rows
        ]
        return [header, *lines]

    def _figures(
        self,
        runs: Sequence[Predictions],
        methods: Sequence[UeMethod],
        judging: JudgingConfig,
        tolerance_m: float,
    ) -> list[tuple[Path, bytes]]:
        """Return the pictures of every run by every method."""
        # matplotlib is an extra, and slow to load
        from uasthn_cli.evaluation.figures import Curve, draw_evaluation

        curves = []
        names = run_names([run.settings for run in runs])
        for name, run in zip(names, runs, strict=True):
            offset_m = run.settings.max_offset_m
            place = "" if offset_m is None else f", D_C {offset_m:g} m"
            for method in methods:
                if refusal(run, method) is None:
                    judged = judge(run, method, judging)
                    curves.append(Curve(f"{name}{place}", method, judged))
        files = []
        for file_format in _FORMATS:
            for figure, content in draw_evaluation(curves, tolerance_m, file_format).items():
                if content is not None:
                    files.append((self.folder / f"{figure}.{file_format}", content))
                elif file_format == _FORMATS[0]:
                    click.echo(f"no {figure} figure: nothing to draw", err=True)
        return files


def _is_possible(runs: Sequence[Predictions], method: UeMethod) -> bool:
    return any(refusal(run, method) is None for run in runs)
