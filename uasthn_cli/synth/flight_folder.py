"""A flight's folder on disk: its four parts, and how they appear together."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from uasthn_cli.errors import OutputError


@dataclass(frozen=True, slots=True)
class RenderedFlight:
    """Where a flight's files lie; ``dem`` is None where the ground is flat."""

    map: Path
    frames: Path
    log: Path
    truth: Path
    dem: Path | None = None


def flight_in(folder: Path) -> RenderedFlight:
    """Return where the parts of a flight in ``folder`` are, or will be."""
    dem = dem_in(folder)
    return RenderedFlight(
        folder / "map.tif",
        folder / "frames",
        folder / "flight.tlog",
        folder / "truth.csv",
        dem if dem.exists() else None,
    )


def dem_in(folder: Path) -> Path:
    """Return where the heights of the ground of a flight in ``folder`` are, if it has any."""
    return folder / "dem.tif"


@contextmanager
def staged_flight(out: Path, *, overwrite: bool) -> Iterator[RenderedFlight]:
    """Yield where to write a flight; it becomes ``out`` when all is written, and never in part.

    Raises:
        OutputError: the folder exists already and ``overwrite`` is false, is not a rendered
            flight, or cannot be written.
    """
    _check_target(out, overwrite)
    staging = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        (staging / "frames").mkdir(parents=True)
        yield flight_in(staging)
        _swap(staging, out)
    except OSError as error:
        raise OutputError(f"cannot write {out}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _check_target(out: Path, overwrite: bool) -> None:
    """Refuse to replace what was not asked to be replaced, or is no rendered flight."""
    if not out.exists():
        return
    if not overwrite:
        raise OutputError(f"{out} exists already; choose another folder or give --overwrite")
    if not out.is_dir() or not {"map.tif", "truth.csv"} <= {p.name for p in out.iterdir()}:
        raise OutputError(f"{out} is not a rendered flight, so it is not overwritten")


def _swap(staging: Path, out: Path) -> None:
    """Put the finished folder in its place; the one that stood there goes last."""
    if not out.exists():
        staging.replace(out)
        return
    retired = out.with_name(f".{out.name}.{os.getpid()}.old")
    out.replace(retired)
    staging.replace(out)
    shutil.rmtree(retired, ignore_errors=True)
