"""The CSV log of a training run: a row per checkpoint, no row twice, whatever was interrupted."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from uasthn_cli.errors import OutputError
from uasthn_cli.outputs.atomic import write_text
from uasthn_cli.training.loop import Progress, Validation

COLUMNS: Final = (
    "step",
    "seconds",
    "loss",
    "median_error_px",
    "within_4_px",
    "validation_median_error_px",
    "validation_within_4_px",
)


@dataclass(frozen=True, slots=True)
class _Earlier:
    """What a log says of the steps before a checkpoint."""

    rows: dict[int, list[str]]
    seconds: float


class StepLog:
    """Rows by step; the file is replaced as a whole with every row.

    The first two columns are the step and the seconds that the run has taken.
    """

    def __init__(self, path: Path, step: int, columns: Sequence[str]) -> None:
        """Go on after ``step``: earlier rows stay, later ones (never checkpointed) go.

        Raises:
            OutputError: the file is not a log of training with these columns.
        """
        self._path, self._columns = path, tuple(columns)
        has_earlier = step > 0 and path.exists()
        earlier = _read(path, step, self._columns) if has_earlier else _Earlier({}, 0.0)
        self._rows, self._seconds_before = earlier.rows, earlier.seconds

    def write_row(self, step: int, seconds: float, figures: Sequence[str]) -> None:
        """Write the row of a step, or write it again; ``seconds`` are those since this start.

        Raises:
            OutputError: the file cannot be written.
        """
        self._rows[step] = [str(step), f"{self._seconds_before + seconds:.1f}", *figures]
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self._columns)
        writer.writerows(self._rows.values())
        write_text(self._path, buffer.getvalue())


class TrainingLog(StepLog):
    """The log of ``uasthn train``."""

    def __init__(self, path: Path, step: int) -> None:
        """Go on after ``step``.

        Raises:
            OutputError: the file is not a log of training.
        """
        super().__init__(path, step, COLUMNS)

    def record(self, progress: Progress, validation: Validation | None = None) -> None:
        """Write the row of a step, or write it again with its validation.

        Raises:
            OutputError: the file cannot be written.
        """
        figures = [
            f"{progress.loss:.4f}",
            f"{progress.median_error_px:.3f}",
            f"{progress.within_4_px:.4f}",
        ]
        if validation is None:
            figures += ["", ""]
        else:
            figures += [f"{validation.median_error_px:.3f}", f"{validation.within_4_px:.4f}"]
        self.write_row(progress.step, progress.seconds, figures)


def _read(path: Path, step: int, columns: tuple[str, ...]) -> _Earlier:
    """Return the rows up to a step and the time that the last of them states."""
    refusal = f"{path}: not a log of training; move it away or choose another --out"
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        if tuple(header) != columns:
            raise OutputError(refusal)
        kept = {int(row[0]): row for row in rows if int(row[0]) <= step}
        return _Earlier(kept, max((float(row[1]) for row in kept.values()), default=0.0))
    except (OSError, ValueError, IndexError) as error:
        raise OutputError(refusal) from error
