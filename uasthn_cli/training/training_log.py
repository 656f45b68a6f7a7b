"""The CSV log of a training run: a row per checkpoint, no row twice, whatever was interrupted."""

import csv
import io
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


class TrainingLog:
    """Rows by step; the file is replaced as a whole with every row."""

    def __init__(self, path: Path, step: int) -> None:
        """Go on after ``step``: earlier rows stay, later ones (never checkpointed) go.

        Raises:
            OutputError: the file is not a log of training.
        """
        self._path = path
        earlier = _read(path, step) if step > 0 and path.exists() else _Earlier({}, 0.0)
        self._rows, self._seconds_before = earlier.rows, earlier.seconds

    def record(self, progress: Progress, validation: Validation | None = None) -> None:
        """Write the row of a step, or write it again with its validation.

        Raises:
            OutputError: the file cannot be written.
        """
        figures = [
            f"{self._seconds_before + progress.seconds:.1f}",
            f"{progress.loss:.4f}",
            f"{progress.median_error_px:.3f}",
            f"{progress.within_4_px:.4f}",
        ]
        if validation is None:
            figures += ["", ""]
        else:
            figures += [f"{validation.median_error_px:.3f}", f"{validation.within_4_px:.4f}"]
        self._rows[progress.step] = [str(progress.step), *figures]
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(self._rows.values())
        write_text(self._path, buffer.getvalue())


def _read(path: Path, step: int) -> _Earlier:
    """Return the rows up to a step and the time that the last of them states."""
    refusal = f"{path}: not a log of training; move it away or choose another --out"
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        if tuple(header) != COLUMNS:
            raise OutputError(refusal)
        kept = {int(row[0]): row for row in rows if int(row[0]) <= step}
        return _Earlier(kept, max((float(row[1]) for row in kept.values()), default=0.0))
    except (OSError, ValueError, IndexError) as error:
        raise OutputError(refusal) from error
