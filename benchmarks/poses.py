"""How well camera, centre and corners are found on flights with the errors of real aircraft.

    python benchmarks/poses.py OUT --frames 50 --seed 31 --seed 32

renders a flight of each kind and seed, geo-tags it, and prints a row per kind; flights that are
there already are taken as they are.
"""

import csv
import math
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click
import numpy as np

KINDS: Final[dict[str, Sequence[str]]] = {
    "drift of the position alone": (),
    "mount 1.5°, -2.5°": ("--mount-roll", "1.5", "--mount-pitch", "-2.5"),
    "mount 1°, -2°, attitude drifts by 1.5°": (
        *("--mount-roll", "1", "--mount-pitch", "-2", "--attitude-drift-deg", "1.5"),
    ),
    "relief of 80 m": ("--relief-m", "80"),
    "lens k1 -0.25": ("--lens-k1", "-0.25"),
    "all: mount, drift 1°, relief 60 m, k1 -0.12, clock 0.4 s": (
        *("--mount-roll", "1", "--mount-pitch", "-2", "--attitude-drift-deg", "1"),
        *("--relief-m", "60", "--lens-k1", "-0.12", "--clock-late-s", "0.4"),
    ),
}
_COLUMNS: Final = ("ce_m", "camera_ce_m", "mace_m", "ce90_m", "camera_ce90_m")


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--frames", default=50, show_default=True)
@click.option("--seed", "seeds", multiple=True, type=int, required=True)
@click.option("--without-dem", is_flag=True, help="Relief is unknown to geotag.")
def poses(out: Path, frames: int, seeds: tuple[int, ...], without_dem: bool) -> None:
    """Print median / 90 % of accepted frames' errors in metres, and how often CE90 holds them."""
    click.echo("kind | frames | centre | camera | corners | within CE90: centre | camera")
    for number, (kind, options) in enumerate(KINDS.items()):
        rows = [
            row
            for seed in seeds
            for row in _errors(out / f"{number}-{seed}", seed, frames, options, without_dem)
        ]
        values = np.array(rows)
        found = [
            f"{np.median(values[:, k]):.2f} / {np.percentile(values[:, k], 90):.2f}"
            for k in range(3)
        ]
        held = [f"{np.mean(values[:, k] <= values[:, k + 3]):.2f}" for k in range(2)]
        click.echo(" | ".join([kind, f"{len(rows)} of {frames * len(seeds)}", *found, *held]))


def _errors(
    folder: Path, seed: int, frames: int, options: Sequence[str], without_dem: bool
) -> list[list[float]]:
    """Return errors and radii of the accepted frames of one flight."""
    if not folder.exists():
        kind = ("mixed", "farms")[seed % 2]
        place = ("--seed", str(seed), "--kind", kind, "--frames", str(frames))
        _run("synth", str(folder), *place, "--height-m", "266", *options)
    results = folder.with_name(f"{folder.name}-results")
    dem = folder / "dem.tif"
    ground = ("--dem", str(dem)) if dem.exists() and not without_dem else ()
    _run(
        *("geotag", str(folder / "flight.tlog"), str(folder / "frames")),
        *("--map", str(folder / "map.tif"), "--truth", str(folder / "truth.csv")),
        *("--hfov", "45", "--out", str(results), "--overwrite", *ground),
    )
    with (results / "frames.csv").open(encoding="utf-8", newline="") as handle:
        rows = [row for row in csv.DictReader(handle) if row["accepted"] == "true"]
    errors = [[float(row[name] or math.nan) for name in _COLUMNS] for row in rows]
    return [row for row in errors if not any(map(math.isnan, row))]


def _run(*arguments: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "uasthn_cli", *arguments],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


if __name__ == "__main__":
    poses()
