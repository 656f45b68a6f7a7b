"""``uasthn geotag``: a log, frames and a map in; a place for every frame out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from uasthn_cli.commands.cache_option import cache_option
from uasthn_cli.commands.console import say
from uasthn_cli.commands.jobs_option import jobs_option
from uasthn_cli.commands.matching_options import matching_options, search_option, trust_option
from uasthn_cli.commands.options import (
    camera_options,
    out_option,
    output_option,
    overwrite_option,
    prior_options,
    time_option,
)
from uasthn_cli.commands.parameter_types import CrsType
from uasthn_cli.commands.sections import SectionedCommand, section_option
from uasthn_cli.config import GeotagConfig, PriorConfig

if TYPE_CHECKING:
    from uasthn_cli.ingest.cameras import CameraSpec
    from uasthn_cli.pipeline import GeotagJob
    from uasthn_cli.pipeline.job import BoxCalibration
    from uasthn_cli.types import FrameResult
    from uasthn_cli.uncertainty.calibration import Calibration

_EXAMPLES: Final = """\
\b
A camera with 45° of view; 200 m around the logged positions are searched:
  uasthn geotag flight.tlog frames/ --map map.tif --hfov 45
\b
A GPS that may be 450 m off, positions in the map's own reference system too:
  uasthn geotag flight.tlog frames/ --map map.tif --camera boson640-18mm \\
      --search-radius 450 --crs map --out out/flight
\b
The camera's clock is 2.5 s slow: a frame stamped 12:00:00 shows what the log
has at 12:00:02.5:
  uasthn geotag flight.tlog frames/ --map map.tif --hfov 45 \\
      --time-offset 2.5 --out out/flight
\b
Interrupted? Give the same command again: it goes on where it stopped.
"""

_REASONS_EXPLAINED: Final = 3
"""The commonest ones: a line each."""

input_option = section_option("Input")


@click.command(
    cls=SectionedCommand,
    epilog=_EXAMPLES,
    short_help="Find out where each frame was taken, and how sure that is.",
)
@click.argument("log_path", metavar="LOG", type=click.Path(path_type=Path))
@click.argument("frames_path", metavar="FRAMES", type=click.Path(path_type=Path))
@input_option(
    "--map",
    "map_path",
    type=click.Path(path_type=Path),
    required=True,
    metavar="MAP",
    help="Georeferenced image of the area, any raster that GDAL reads.",
)
@out_option(
    "Folder for frames.csv, frames.geojson and run.json.  [default: LOG-geotag, a new folder named"
    " by the log]",
    required=False,
)
@overwrite_option
@cache_option
@jobs_option
@output_option(
    "--crs",
    type=CrsType(),
    metavar="map|EPSG:n",
    help="Add columns with camera and centre in the map's reference system, or any other.",
)
@output_option(
    "--truth",
    "truth_path",
    type=click.Path(path_type=Path),
    metavar="CSV",
    help="True positions, for columns with the errors (frame, center_lat, center_lon, tl_lat …"
    " br_lon; optionally lat, lon).",
)
@camera_options
@prior_options
@time_option(
    "--frame-times",
    "frame_times_csv",
    type=click.Path(path_type=Path),
    metavar="CSV",
    help="Capture times by file name (columns frame, time) instead of the log's, names' or EXIF's.",
)
@matching_options
@search_option(
    "--weights",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="FILE",
    help="Network weights from `uasthn train`, or for the vismatch matcher; several times for a"
    " deep ensemble, the base network first (xcorr averages the networks' scores).  [default: those"
    " of the package]",
)
@trust_option(
    "--calibration",
    "calibration_name",
    metavar="FILE|default|none",
    default="default",
    show_default=True,
    help="By what answers are accepted: a file of `uasthn calibrate`, the one made for the weights"
    " in the box, or plain limits (--max-std, --min-confidence).",
)
def geotag(
    log_path: Path,
    frames_path: Path,
    map_path: Path,
    out: Path | None,
    overwrite: bool,
    cache_dir: Path | None,
    jobs: int | None,
    crs: str | None,
    truth_path: Path | None,
    frame_times_csv: Path | None,
    weights: tuple[Path, ...],
    calibration_name: str,
    camera: "CameraSpec",
    prior: PriorConfig,
    config: GeotagConfig,
) -> None:
    """Find out where each frame was taken, and how far that can be trusted.

    LOG is the flight's MAVLink telemetry log (.tlog), FRAMES a folder of thermal frames that look
    straight down. Every frame becomes a row; a frame that cannot be placed says why.
    """
    from uasthn_cli.commands.geotag_run import Target, geotag_to_folder
    from uasthn_cli.outputs.run_writer import folder_of_log
    from uasthn_cli.pipeline import GeotagJob
    from uasthn_cli.pipeline.job import chosen_calibration

    require_known_crs(crs)
    job = GeotagJob(
        log_path=log_path,
        frames_path=frames_path,
        map_path=map_path,
        camera=camera,
        prior=prior,
        frame_times_csv=frame_times_csv,
        config=config,
        weights=weights,
        calibration=asked_calibration(calibration_name),
        cache_dir=cache_dir,
        jobs=jobs,
    )
    job = replace(job, calibration=chosen_calibration(job))
    require_consistent(job)
    target = Target(
        out or folder_of_log(log_path), truth_path, crs, overwrite, is_named=out is not None
    )
    results = geotag_to_folder(job, target)
    if job.calibration is None and calibration_name == "default":
        say("Answers are judged by plain limits: no calibration came with these weights")
    say_summary(results)
    say(f"Results are in {target.out}; figures: uasthn report {target.out}")


def asked_calibration(name: str) -> "Calibration | BoxCalibration | None":
    """Return the calibration asked for.

    Raises:
        CalibrationError: the file cannot be used.
    """
    from uasthn_cli.pipeline.job import BOX_CALIBRATION
    from uasthn_cli.uncertainty.calibration import load_calibration

    if name == "default":
        return BOX_CALIBRATION
    return None if name == "none" else load_calibration(Path(name))


def require_consistent(job: "GeotagJob") -> None:
    """Check that method of uncertainty, weights and settings fit together, before any work."""
    from uasthn_cli.pipeline.job import chosen_jobs, chosen_uncertainty

    try:
        chosen_uncertainty(job)
        chosen_jobs(job)
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def require_known_crs(crs: str | None) -> None:
    """Check an EPSG code against PROJ's database before any work is done."""
    from uasthn_cli.geometry.geodesy import is_geographic

    if crs is not None and crs != "map":
        try:
            is_geographic(crs)
        except ValueError as error:
            raise click.BadParameter(str(error), param_hint="--crs") from error


def say_summary(results: "Sequence[FrameResult]") -> None:
    """Say how many frames were accepted, and why the others were not, with an example each."""
    from uasthn_cli.outputs.formatting import frame_of
    from uasthn_cli.outputs.run_record import counts

    figures = counts(results)
    say(f"{figures['accepted']} of {figures['frames']} frames accepted")
    by_reason = sorted(figures["reasons"].items(), key=lambda item: -item[1])
    if by_reason:
        say("Not accepted: " + ", ".join(f"{count} {reason}" for reason, count in by_reason))
    for reason, _ in by_reason[:_REASONS_EXPLAINED]:
        example = next(result for result in results if result.reason == reason)
        if example.detail:
            say(f"  {reason}, for example {frame_of(example).name}: {example.detail}")
