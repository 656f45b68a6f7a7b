"""A results folder: checked before the work, written whole after it."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from uasthn_cli.errors import OutputError
from uasthn_cli.outputs import atomic
from uasthn_cli.outputs.geojson import frames_geojson
from uasthn_cli.outputs.journal import JOURNAL_NAME
from uasthn_cli.outputs.run_record import RunRecord, run_json
from uasthn_cli.outputs.table import frames_csv
from uasthn_cli.outputs.truth import Truth
from uasthn_cli.types import FrameResult

FRAMES_CSV: Final = "frames.csv"
FRAMES_GEOJSON: Final = "frames.geojson"
RUN_JSON: Final = "run.json"
_RESULTS: Final = (FRAMES_CSV, FRAMES_GEOJSON, RUN_JSON)


def folder_of_log(log_path: Path) -> Path:
    """Return the folder, in the working folder, for results that nobody named one for."""
    return Path(f"{log_path.stem}-geotag")


def prepare_output(out_dir: Path, overwrite: bool, *, is_named: bool = True) -> None:
    """Create a results folder, or check that one may be written; call it before any work.

    What an interrupted run left behind (a journal, and perhaps tables without ``run.json``) is no
    obstacle; finished results are, unless ``overwrite``, and so is anything else in a folder that
    nobody named. Nothing of them is touched here.

    Raises:
        OutputError: the folder holds results, is a file, or cannot be written.
    """
    if out_dir.exists() and not out_dir.is_dir():
        raise OutputError(f"{out_dir} is a file: name a folder with --out")
    found = [name for name in _RESULTS if (out_dir / name).exists()]
    interrupted = (out_dir / JOURNAL_NAME).exists() and RUN_JSON not in found
    if found and not overwrite and not interrupted:
        raise OutputError(
            f"{out_dir} already holds results ({', '.join(found)}):"
            " name another folder with --out, or add --overwrite"
        )
    if not (is_named or overwrite or interrupted) and out_dir.exists() and any(out_dir.iterdir()):
        raise OutputError(
            f"{out_dir} exists and is not empty: name a folder with --out, or add --overwrite"
        )
    _require_writable(out_dir)


def write_run(
    out_dir: Path,
    results: Sequence[FrameResult],
    record: RunRecord,
    truth: Truth | None,
    crs: str | None,
) -> None:
    """Write ``frames.csv``, ``frames.geojson`` and, as the mark of a complete run, ``run.json``.

    All three are on disk in full before the first takes its place; earlier results stay as they
    are until then.

    Raises:
        OutputError: a file cannot be written.
        ValueError: the CRS is not understood.
    """
    contents: dict[str, Iterable[str]] = {
        FRAMES_CSV: frames_csv(results, truth, crs),
        FRAMES_GEOJSON: frames_geojson(results),
        RUN_JSON: [run_json(record, results)],
    }
    files = [
        (out_dir / name, (text.encode("utf-8") for text in texts))
        for name, texts in contents.items()
    ]
    atomic.write_files(files, marker=out_dir / RUN_JSON)


def _require_writable(out_dir: Path) -> None:
    """Create the folder, clear what killed runs left half-written, and try a file."""
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot create {out_dir}: {error.strerror or error}") from error
    for name in _RESULTS:
        atomic.remove_leftovers(out_dir / name)
    probe = out_dir / ".uasthn-probe"
    atomic.write_bytes(probe, b"")
    probe.unlink(missing_ok=True)
