"""One geo-tagging run from its inputs to a results folder; ``geotag`` and ``demo`` share it."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from uasthn_cli.commands.console import say
from uasthn_cli.commands.flight_lines import flight_record
from uasthn_cli.commands.geotag_steps import finish_run, geotag_journals, lines_of
from uasthn_cli.outputs.run_record import (
    RunRecord,
    RunTiming,
    file_identity,
    fingerprint_of,
    frames_sha256,
)
from uasthn_cli.outputs.run_writer import prepare_output, write_run
from uasthn_cli.outputs.truth import read_truth
from uasthn_cli.pipeline import GeotagJob, Run, open_run
from uasthn_cli.pipeline.diagnosis import Diagnosis, line_of
from uasthn_cli.types import FrameResult

MAP_CRS: Final = "map"


@dataclass(frozen=True, slots=True)
class Target:
    """Where results go: ``crs`` adds positions in ``map``'s or any other reference system.

    ``is_named`` tells whether somebody asked for this very folder.
    """

    out: Path
    truth_path: Path | None = None
    crs: str | None = None
    overwrite: bool = False
    is_named: bool = True


def geotag_to_folder(job: GeotagJob, target: Target) -> list[FrameResult]:
    """Geo-tag a flight, write its results folder and return the results in frame order.

    A run that was interrupted goes on from its journals.

    Raises:
        UasthnError: an input or the output cannot be used, or Ctrl-C (``RunInterruptedError``).
    """
    started_utc_s, started_s = time.time(), time.perf_counter()
    truth = None if target.truth_path is None else read_truth(target.truth_path)
    with open_run(job) as run:
        if run.priors.frame_times.pairing is not None:
            say(f"Frames and camera messages: {run.priors.frame_times.why}")
        if run.ground is not None:
            say(run.ground.line(run.priors.results))
        if truth is not None:
            truth.require_match(run.names)
        prepare_output(target.out, target.overwrite, is_named=target.is_named)
        inputs = _inputs(job, run)
        fingerprint = fingerprint_of(job.config, job.prior, job.camera, run.calibration, inputs)
        with geotag_journals(target.out, fingerprint) as journals:
            outcome = finish_run(run, journals)
            diagnosis = run.diagnose(outcome.results)
            record = RunRecord(
                arguments=_arguments(job, target),
                inputs=inputs if truth is None else inputs | {"truth": _file(truth.path)},
                timing=RunTiming(
                    started_utc_s=started_utc_s,
                    wall_s=time.perf_counter() - started_s,
                    computed_frames=outcome.computed_frames,
                    stage_s={**run.timings, "write": outcome.write_s},
                    jobs=run.jobs,
                    cache_dir=job.cache_dir,
                ),
                calibration=run.calibration,
                flight=None
                if outcome.flight is None
                else flight_record(outcome.flight, outcome.poses),
                **_described(job, run, diagnosis),
            )
            crs = run.map_crs if target.crs == MAP_CRS else target.crs
            write_run(target.out, outcome.results, record, truth, crs)
            journals.remove()
        # what a flight that fits nowhere taught of its camera is chance
        for line in lines_of(job, outcome) if diagnosis is None else ():
            say(line)
        if run.calibration is not None:
            say(f"Promised by the calibration: {run.calibration.promise}")
        if diagnosis is not None:
            say(line_of(diagnosis, job.camera, job.prior.time_offset_s))
    return outcome.results


def _inputs(job: GeotagJob, run: Run) -> dict[str, Any]:
    """Return path and SHA-256 of everything that shapes the results."""
    frames = [entry.frame for entry in run.priors.results]
    named = {
        "log": job.log_path,
        "map": job.map_path,
        **_weights_paths(job),
        "frame_times": job.frame_times_csv,
        "dem": job.prior.dem_path,
    }
    files = {name: _file(path) for name, path in named.items() if path is not None}
    if job.spec.package is not None:
        files["estimator"] = {"package": job.spec.package}
    digest = {"path": job.frames_path, "count": len(frames), "sha256": frames_sha256(frames)}
    return {"frames": digest, **files}


def _weights_paths(job: GeotagJob) -> dict[str, Path]:
    """Return the files that networks are loaded from: none of ncc, or if vismatch has its own."""
    in_the_box = job.spec.bundled_weights
    paths = job.weights or (in_the_box if job.config.ensemble else in_the_box[:1])
    if len(paths) == 1:
        return {"weights": paths[0]}
    return {f"weights_{k}": path for k, path in enumerate(paths, start=1)}


def _file(path: Path) -> dict[str, Any]:
    """Return a file's path and what tells it from others."""
    return {"path": path, **file_identity(path)}


def _arguments(job: GeotagJob, target: Target) -> dict[str, Any]:
    """Return what was asked for, apart from inputs and the output folder."""
    return {"prior": job.prior, "config": job.config, "crs": target.crs}


def _described(job: GeotagJob, run: Run, diagnosis: Diagnosis | None) -> dict[str, Any]:
    """Return the sections of the run record that say what was chosen, and why."""
    chosen = run.describe()
    return {
        "camera": job.camera,
        "time_base": chosen.pop("time_base"),
        "frame_times": chosen.pop("frame_times"),
        "notes": chosen | {"diagnosis": diagnosis and diagnosis.describe()},
    }
