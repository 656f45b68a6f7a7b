"""One geo-tagging run from its inputs to a results folder; ``geotag`` and ``demo`` share it."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from uasthn_cli.commands.console import progress
from uasthn_cli.errors import RunInterruptedError
from uasthn_cli.matching.memory import keep_freed_memory
from uasthn_cli.outputs.journal import Journal
from uasthn_cli.outputs.run_record import (
    RunRecord,
    RunTiming,
    file_sha256,
    fingerprint_of,
    frames_sha256,
)
from uasthn_cli.outputs.run_writer import prepare_output, write_run
from uasthn_cli.outputs.truth import read_truth
from uasthn_cli.pipeline import GeotagJob, Run, open_run
from uasthn_cli.types import FrameResult

MAP_CRS: Final = "map"


@dataclass(frozen=True, slots=True)
class Target:
    """Where results go: ``crs`` adds positions in ``map``'s or any other reference system."""

    out: Path
    truth_path: Path | None = None
    crs: str | None = None
    overwrite: bool = False


def geotag_to_folder(job: GeotagJob, target: Target) -> list[FrameResult]:
    """Geo-tag a flight, write its results folder and return the results in frame order.

    A run that was interrupted goes on from its journal.

    Raises:
        UasthnError: an input or the output cannot be used, or Ctrl-C (``RunInterruptedError``).
    """
    keep_freed_memory()
    started_utc_s, started_s = time.time(), time.perf_counter()
    truth = None if target.truth_path is None else read_truth(target.truth_path)
    with open_run(job) as run:
        names = [entry.frame.name for entry in run.priors.results]
        if truth is not None:
            truth.require_match(names)
        prepare_output(target.out, target.overwrite)
        inputs = _inputs(job, run)
        fingerprint = fingerprint_of(job.config, job.prior, job.camera, inputs)
        with _journal(target.out, fingerprint) as journal:
            taken_over = len(journal.finished)
            write_s = _finish(run, journal, target.out)
            results = [journal.finished[name] for name in names]
            record = RunRecord(
                arguments=_arguments(job, target),
                inputs=inputs if truth is None else inputs | {"truth": _file(truth.path)},
                timing=RunTiming(
                    started_utc_s=started_utc_s,
                    wall_s=time.perf_counter() - started_s,
                    computed_frames=len(names) - taken_over,
                    stage_s={**run.timings, "write": write_s},
                ),
                **_described(job, run),
            )
            crs = run.map_crs if target.crs == MAP_CRS else target.crs
            write_run(target.out, results, record, truth, crs)
            journal.remove()
    return results


@contextmanager
def _journal(out: Path, fingerprint: str) -> Iterator[Journal]:
    """Open the journal; one that holds no frame when the run ends badly leaves no trace."""
    with Journal(out, fingerprint) as journal:
        try:
            yield journal
        except BaseException:
            if not journal.finished:
                journal.remove()
                if not any(out.iterdir()):
                    out.rmdir()
            raise


def _finish(run: Run, journal: Journal, out: Path) -> float:
    """Compute what the journal does not hold yet; return the seconds spent on writing it."""
    write_s = 0.0
    total = run.frame_count
    try:
        with progress("geo-tagging", total, done=len(journal.finished)) as advance:
            for result in run.results(skip=frozenset(journal.finished)):
                before_s = time.perf_counter()
                journal.append(result)
                write_s += time.perf_counter() - before_s
                advance(len(journal.finished))
    except KeyboardInterrupt as interrupt:
        raise RunInterruptedError(
            f"interrupted after {len(journal.finished)} of {total} frames, which are kept in"
            f" {out}; give the same command again to go on"
        ) from interrupt
    return write_s


def _inputs(job: GeotagJob, run: Run) -> dict[str, Any]:
    """Return path and SHA-256 of everything that shapes the results."""
    frames = [entry.frame for entry in run.priors.results]
    named = {
        "log": job.log_path,
        "map": job.map_path,
        "weights": _weights_path(job),
        "frame_times": job.frame_times_csv,
    }
    files = {name: _file(path) for name, path in named.items() if path is not None}
    digest = {"path": job.frames_path, "count": len(frames), "sha256": frames_sha256(frames)}
    return {"frames": digest, **files}


def _weights_path(job: GeotagJob) -> Path | None:
    """Return the file that networks are loaded from; None without any, or if vismatch has it."""
    if job.weights_path is not None or job.config.estimator != "xcorr":
        return job.weights_path
    from uasthn_cli.matching.weights import BUNDLED_XCORR

    return BUNDLED_XCORR


def _file(path: Path) -> dict[str, Any]:
    """Return a file's path and SHA-256."""
    return {"path": path, "sha256": file_sha256(path)}


def _arguments(job: GeotagJob, target: Target) -> dict[str, Any]:
    """Return what was asked for, apart from inputs and the output folder."""
    return {"prior": job.prior, "config": job.config, "crs": target.crs}


def _described(job: GeotagJob, run: Run) -> dict[str, Any]:
    """Return the sections of the run record that say what was chosen, and why."""
    chosen = run.describe()
    return {
        "camera": job.camera,
        "time_base": chosen.pop("time_base"),
        "frame_times": chosen.pop("frame_times"),
        "notes": chosen,
    }
