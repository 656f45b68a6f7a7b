"""Compare estimators on flights with truth: same frames, same windows, same GSD, one process.

    python benchmarks/estimators.py FLIGHT_DIR [FLIGHT_DIR…] --hfov 45 --search-radius M […]

A flight is a folder with ``flight.tlog``, ``frames/``, ``map.tif`` and ``truth.csv``.
"""

import csv
import io
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import click
import numpy as np
from flight_options import each, flight_arguments
from keypoints import akaze_magsac, has_akaze, sift_magsac
from mutual_information import MiChannel, MutualInformationEstimator
from phase_correlation import PhaseCorrelationEstimator
from prior import PriorEstimator
from tables import machine_line, markdown_table, number, use_threads

from uasthn_cli.config import TOLERANCE_M, GeotagConfig
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.matching.memory import keep_freed_memory
from uasthn_cli.matching.ncc import NccChannel, NccEstimator
from uasthn_cli.outputs.atomic import write_text
from uasthn_cli.outputs.formatting import frame_of
from uasthn_cli.outputs.truth import Truth, center_error_m, read_truth
from uasthn_cli.pipeline import GeotagJob, drive, open_run
from uasthn_cli.seam import Estimator
from uasthn_cli.types import BoolArray, Fix, FloatArray, FrameResult

UNIT = "ncc"
"""The estimator whose time others are counted in."""

AKAZE = "akaze-magsac"

ESTIMATORS: dict[str, Callable[[], Estimator | None]] = {
    "prior": PriorEstimator,
    AKAZE: akaze_magsac,
    "sift-magsac": sift_magsac,
    "phase-correlation": PhaseCorrelationEstimator,
    "mi-local": lambda: MutualInformationEstimator(MiChannel.LOCAL),
    "mi": MutualInformationEstimator,
    "ncc-gradient": lambda: NccEstimator(NccChannel.GRADIENT),
    "ncc": NccEstimator,
    "xcorr": lambda: None,
    "ncc-flight": NccEstimator,
    "xcorr-flight": lambda: None,
}
"""None: the tool's own, as its users run it."""
FLIGHT = "-flight"
"""Ends the names of estimators whose answers the whole flight settles."""


@dataclass(frozen=True, slots=True)
class Score:
    """One estimator on one flight; a frame without an answer is infinitely far off.

    ``seconds_per_frame`` is what the estimator itself takes: features of the map (once per flight)
    and search. ``accepted_*`` are NaN where nothing was accepted.
    """

    flight: str
    search_radius_m: float
    estimator: str
    frames: int
    ce_median_m: float
    ce_p90_m: float
    within_25m: float
    accepted: float
    accepted_within_25m: float
    accepted_ce_median_m: float
    seconds_per_frame: float


def score(job: GeotagJob, flight: str, name: str, truth: Truth) -> Score:
    """Run one estimator over a flight and compare with the truth."""
    job = replace(job, config=replace(job.config, fuse=name.endswith(FLIGHT)))
    with open_run(job, ESTIMATORS[name]()) as run:
        results = drive(run).results
        own_s = sum(run.timings.get(stage, 0.0) for stage in ("features", "search", "fuse"))
    known = [result for result in results if frame_of(result).name in truth.frames]
    ce_m = np.array([_ce_m(result, truth) for result in known])
    accepted = np.array([isinstance(result, Fix) and result.accepted for result in known])
    return Score(
        flight=flight,
        search_radius_m=job.config.search_radius_m,
        estimator=name,
        frames=len(known),
        ce_median_m=_quantile(ce_m, 0.5),
        ce_p90_m=_quantile(ce_m, 0.9),
        within_25m=_share(ce_m <= TOLERANCE_M),
        accepted=_share(accepted),
        accepted_within_25m=_share(ce_m[accepted] <= TOLERANCE_M),
        accepted_ce_median_m=_quantile(ce_m[accepted], 0.5),
        seconds_per_frame=own_s / max(len(results), 1),
    )


def as_markdown(scores: list[Score], threads: int) -> str:
    """Return a table per flight and a line about the machine."""
    columns = (
        *("estimator", "median CE m", "90 % CE m", "within 25 m", "accepted"),
        *("of these within 25 m", "their median CE m", "s/frame", f"× {UNIT}"),
    )
    parts = []
    for flight in dict.fromkeys(entry.flight for entry in scores):
        own = [entry for entry in scores if entry.flight == flight]
        units_s = [entry.seconds_per_frame for entry in own if entry.estimator == UNIT]
        title = f"**{flight}**: {own[0].frames} frames, search radius {own[0].search_radius_m:g} m"
        rows = [_cells(entry, units_s[0] if units_s else math.nan) for entry in own]
        parts += [title, markdown_table(columns, rows)]
    return "\n\n".join([*parts, machine_line(threads)]) + "\n"


def as_csv(scores: list[Score]) -> str:
    """Return one row per flight and estimator; what is not finite stays empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(Score)])
    for entry in scores:
        writer.writerow(_plain(value) for value in asdict(entry).values())
    return text.getvalue()


@click.command()
@flight_arguments
@click.option(
    "--estimator",
    "names",
    type=click.Choice(list(ESTIMATORS)),
    multiple=True,
    default=tuple(ESTIMATORS),
    help="Leave out for all.",
)
@click.option("--threads", type=int, default=os.cpu_count() or 1, show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/benchmarks"),
    show_default=True,
    help="Folder for estimators.csv and estimators.md.",
)
def main(
    folders: tuple[Path, ...],
    hfovs_deg: tuple[float, ...],
    radii_m: tuple[float, ...],
    names: tuple[str, ...],
    threads: int,
    out: Path,
) -> None:
    """Compare estimators on flights with truth."""
    each_deg = each("--hfov", hfovs_deg, folders)
    each_m = each("--search-radius", radii_m, folders)
    if AKAZE in names and not has_akaze():
        click.echo(
            f"{AKAZE}: left out; OpenCV 5 has it in opencv-contrib-python-headless", err=True
        )
        names = tuple(name for name in names if name != AKAZE)
    use_threads(threads)
    keep_freed_memory()
    scores = []
    for folder, hfov_deg, radius_m in zip(folders, each_deg, each_m, strict=True):
        truth = read_truth(folder / "truth.csv")
        for name in names:
            click.echo(f"{folder.name}: {name}", err=True)
            scores.append(score(_job(folder, hfov_deg, radius_m), folder.name, name, truth))
    table = as_markdown(scores, threads)
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "estimators.csv", as_csv(scores))
    write_text(out / "estimators.md", table)
    click.echo(table, nl=False)


def _job(folder: Path, hfov_deg: float, radius_m: float) -> GeotagJob:
    return GeotagJob(
        log_path=folder / "flight.tlog",
        frames_path=folder / "frames",
        map_path=folder / "map.tif",
        camera=CameraSpec(hfov_deg=hfov_deg),
        config=GeotagConfig(search_radius_m=radius_m),
    )


def _ce_m(result: FrameResult, truth: Truth) -> float:
    if not isinstance(result, Fix):
        return math.inf
    error_m = center_error_m(result, truth.frames[frame_of(result).name])
    return error_m if math.isfinite(error_m) else math.inf


def _quantile(errors_m: FloatArray, quantile: float) -> float:
    """Return a linear quantile that is infinite where answers are missing."""
    if not errors_m.size:
        return math.nan
    above = float(np.quantile(errors_m, quantile, method="higher"))
    return above if math.isinf(above) else float(np.quantile(errors_m, quantile))


def _share(flags: BoolArray) -> float:
    return float(flags.mean()) if flags.size else math.nan


def _cells(entry: Score, unit_s: float) -> list[str]:
    return [
        entry.estimator,
        number(entry.ce_median_m, 1),
        number(entry.ce_p90_m, 1),
        number(entry.within_25m, 2),
        number(entry.accepted, 2),
        number(entry.accepted_within_25m, 2),
        number(entry.accepted_ce_median_m, 1),
        number(entry.seconds_per_frame, 3),
        number(entry.seconds_per_frame / unit_s, 2),
    ]


def _plain(value: object) -> object:
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else ""
    return value


if __name__ == "__main__":
    main()
