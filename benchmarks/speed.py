"""Frames per second and peak memory of ``uasthn geotag``, split by stage.

    python benchmarks/speed.py FLIGHT_DIR --hfov 45 --search-radius M

A flight is a folder with ``flight.tlog``, ``frames/`` and ``map.tif``. It is geo-tagged with the
default estimator, frame by frame and as a whole flight, and with absolute NCC frame by frame, each
in a fresh process, so that each has its own peak.
"""

import json
import multiprocessing
import os
import tempfile
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import click
from tables import machine_line, markdown_table, number, use_threads

from uasthn_cli.commands.geotag_run import Target, geotag_to_folder
from uasthn_cli.config import GeotagConfig
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.outputs.run_record import peak_memory_mib
from uasthn_cli.pipeline import GeotagJob

STAGES = (
    *("log", "decode", "rectify", "map", "features", "search", "fuse", "write", "other"),
    "all",
)
"""With fusion, decode to search count both looks at a frame, fuse what the flight itself takes."""

UNIT = "ncc --no-fuse"
"""The run in whose search times are counted."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One run in a process of its own; ``stage_s`` are whole-flight seconds by stage."""

    frames: int
    stage_s: Mapping[str, float]
    peak_mib: float | None


def measure(job: GeotagJob, threads: int) -> Measurement:
    """Geo-tag a flight into a folder that is thrown away; for a process of its own."""
    use_threads(threads)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        started_s = time.perf_counter()
        results = geotag_to_folder(job, Target(out))
        wall_s = time.perf_counter() - started_s
        timing = json.loads((out / "run.json").read_text(encoding="utf-8"))["timing"]
    stage_s = {name: float(entry["seconds"]) for name, entry in timing["stages"].items()}
    stage_s["write"] += wall_s - timing["wall_s"]
    stage_s["other"] = wall_s - sum(stage_s.values())
    stage_s["all"] = wall_s
    return Measurement(len(results), stage_s, peak_memory_mib())


def as_markdown(title: str, runs: Mapping[str, Measurement], threads: int) -> str:
    """Return the table: milliseconds a frame and the ratio to NCC's search, per stage and run."""
    unit_s = runs[UNIT].stage_s["search"] / runs[UNIT].frames
    columns = ["stage"]
    for name in runs:
        columns += [f"{name} ms/frame", "× ncc search"]
    rows = []
    for stage in STAGES:
        cells = [stage]
        for run in runs.values():
            seconds = run.stage_s.get(stage, 0.0) / run.frames
            cells += [number(1000 * seconds, 1), number(seconds / unit_s, 2)]
        rows.append(cells)
    lines = [
        f"{name}: {run.frames / run.stage_s['all']:.2f} frames/s,"
        f" peak memory {number(run.peak_mib, 0)} MiB"
        for name, run in runs.items()
    ]
    listed = "\n".join(f"- {line}" for line in lines)
    return "\n\n".join([title, markdown_table(columns, rows), listed, machine_line(threads)]) + "\n"


@click.command()
@click.argument("flight", type=click.Path(exists=True, path_type=Path))
@click.option("--hfov", type=float, required=True, metavar="DEG", help="Field of view.")
@click.option("--search-radius", "radius_m", type=float, required=True, metavar="M")
@click.option("--threads", type=int, default=os.cpu_count() or 1, show_default=True)
def main(flight: Path, hfov: float, radius_m: float, threads: int) -> None:
    """Measure the speed and memory of geo-tagging a flight on the CPU."""
    config = GeotagConfig(search_radius_m=radius_m, device="cpu")
    job = GeotagJob(
        log_path=flight / "flight.tlog",
        frames_path=flight / "frames",
        map_path=flight / "map.tif",
        camera=CameraSpec(hfov_deg=hfov),
        config=config,
    )
    runs = {
        name: _in_new_process(replace(job, config=chosen), threads)
        for name, chosen in {
            f"{config.estimator} --no-fuse": replace(config, fuse=False),
            f"{config.estimator} --fuse": replace(config, fuse=True),
            UNIT: replace(config, estimator="ncc", fuse=False),
        }.items()
    }
    title = f"**{flight.name}**: {runs[UNIT].frames} frames, search radius {radius_m:g} m"
    click.echo(as_markdown(title, runs, threads), nl=False)


def _in_new_process(job: GeotagJob, threads: int) -> Measurement:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=context) as executor:
        return executor.submit(measure, job, threads).result()


if __name__ == "__main__":
    main()
