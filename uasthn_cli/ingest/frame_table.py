"""A table of frame times: ``--frame-times FILE.csv``."""

import csv
from pathlib import Path, PureWindowsPath
from typing import Final

from uasthn_cli.errors import FrameTimesError
from uasthn_cli.ingest.timestamps import StatedTime, parse_time

_FRAME_COLUMNS: Final = ("frame", "file", "filename", "file_name", "image", "image_name", "name")
_TIME_COLUMNS: Final = (
    "time", "utc", "time_utc", "utc_time", "time_utc_s", "timestamp", "timestamp_utc", "datetime",
    "date_time", "unix_time_s", "unix_time", "epoch", "unix", "time_s", "time_ms", "time_us",
)  # fmt: skip


def read_frame_table(path: Path) -> dict[str, StatedTime]:
    """Return times by lower-case frame name, with and without folders, from a CSV with a header.

    The first column called ``frame`` (or file, image, name, …) and the first called ``time`` (or
    utc, timestamp, …) are read; times are ISO 8601 or numbers since 1970 in s, ms or µs. Comma,
    semicolon and tab separate. Rows whose time cell is empty are left out.

    Raises:
        FrameTimesError: the table is missing, lacks a column, or holds a time nobody understands.
    """
    rows = _read_rows(path)
    header = [cell.strip().casefold() for cell in rows[0]]
    frame_column = _find(header, _FRAME_COLUMNS)
    time_column = _find(header, _TIME_COLUMNS)
    if frame_column is None or time_column is None:
        raise FrameTimesError(
            f"{path} needs a header with the columns frame,time; it has {','.join(header)}"
        )
    times: dict[str, StatedTime] = {}
    for line, row in enumerate(rows[1:], start=2):
        if len(row) <= max(frame_column, time_column) or not row[time_column].strip():
            continue
        stated = parse_time(row[time_column])
        if stated is None:
            raise FrameTimesError(
                f"{path}, line {line}: {row[time_column]!r} is no time; write ISO 8601"
                " (2018-08-05T01:00:44.80Z) or seconds, ms or µs since 1970"
            )
        name = row[frame_column].strip().casefold()
        times[name] = stated
        times.setdefault(PureWindowsPath(name).name, stated)
    return times


def _read_rows(path: Path) -> list[list[str]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FrameTimesError(f"{path} cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise FrameTimesError(f"{path} is not a text table (UTF-8 CSV)") from error
    first_line = text.lstrip().partition("\n")[0]
    delimiter = max(",;\t", key=first_line.count)
    try:
        rows = [row for row in csv.reader(text.splitlines(), delimiter=delimiter) if any(row)]
    except csv.Error as error:
        raise FrameTimesError(f"{path} is not a CSV table: {error}") from error
    if not rows:
        raise FrameTimesError(f"{path} is empty; write one row frame,time per frame")
    return rows


def _find(header: list[str], names: tuple[str, ...]) -> int | None:
    return next((header.index(name) for name in names if name in header), None)
