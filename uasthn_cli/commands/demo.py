"""``uasthn demo``: render a flight with known truth, geo-tag it, report."""

from pathlib import Path
from typing import Final

import click

from uasthn_cli.commands.cache_option import cache_option
from uasthn_cli.commands.console import progress, say
from uasthn_cli.commands.jobs_option import jobs_option
from uasthn_cli.commands.options import out_option, overwrite_option
from uasthn_cli.commands.sections import SectionedCommand, section_option
from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.errors import RunInterruptedError

_EXAMPLES: Final = """\
\b
Another place, kept where you want it:
  uasthn demo --seed 7 --out out/demo
\b
What it ran, to try other settings on the same flight:
  uasthn geotag DIR/flight/flight.tlog DIR/flight/frames --map DIR/flight/map.tif \\
      --hfov 45 --truth DIR/flight/truth.csv --out DIR/results
"""

_FRAMES: Final = 24

flight_option = section_option("Flight")


@click.command(cls=SectionedCommand, epilog=_EXAMPLES)
@flight_option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    metavar="N",
    help="Which place and which flight are rendered.",
)
@out_option(
    "Folder for the flight and its results.  [default: uasthn-demo]",
    required=False,
    default=Path("uasthn-demo"),
)
@overwrite_option
@cache_option
@jobs_option
def demo(seed: int, out: Path, overwrite: bool, cache_dir: Path | None, jobs: int | None) -> None:
    """Render an example flight, geo-tag it and report.

    The landscape, its night-time thermal frames and a log whose GPS drifts by up to 80 m are made
    up, so the truth is known to the pixel. Takes under two minutes on two CPU cores.
    """
    from uasthn_cli.commands.geotag import say_summary
    from uasthn_cli.commands.geotag_run import Target, geotag_to_folder
    from uasthn_cli.commands.report import print_report
    from uasthn_cli.ingest.cameras import CameraSpec
    from uasthn_cli.pipeline import GeotagJob
    from uasthn_cli.synth.flight import render_flight
    from uasthn_cli.synth.flight_config import FlightConfig

    config = FlightConfig(seed=seed, frames=_FRAMES)
    with progress("rendering", config.frames) as advance:
        flight = render_flight(out / "flight", config, overwrite=overwrite, on_frame=advance)
    job = GeotagJob(
        log_path=flight.log,
        frames_path=flight.frames,
        map_path=flight.map,
        camera=CameraSpec(hfov_deg=config.hfov_deg),
        cache_dir=cache_dir,
        jobs=jobs,
    )
    target = Target(out / "results", flight.truth, overwrite=overwrite)
    try:
        results = geotag_to_folder(job, target)
    except RunInterruptedError as error:
        raise RunInterruptedError(f"interrupted; go on with: {_again(seed, out)}") from error
    say_summary(results)
    print_report([out / "results"], TOLERANCE_M, with_prior=True)
    say(f"The flight is in {flight.map.parent}, the results are in {out / 'results'}")


def _again(seed: int, out: Path) -> str:
    """Return the command that goes on: the same flight is rendered anew, its frames are not."""
    return f"uasthn demo --seed {seed} --out {out} --overwrite"
