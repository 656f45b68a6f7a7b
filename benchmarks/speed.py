"""What ``uasthn geotag`` takes: CPU, time and memory of whole processes, against an older version.

    python benchmarks/speed.py FLIGHT_DIR… --hfov 45 --search-radius M
        [--before "PYTHON -m uasthn_cli" --before-path CHECKOUT] [--only ROWS] [--repeat N]

A flight is a folder with ``flight.tlog``, ``frames/`` and ``map.tif``. Rows that are compared take
turns, so that a machine that is busy for a while is so for all of them.
"""

import shlex
import sys
import tempfile
from pathlib import Path

import click
from flight_options import each, flight_arguments
from speed_cases import GROUPS, Plan, batches, installed, older
from speed_figures import Figures, measure
from speed_inputs import flight_of
from speed_tables import as_csv, as_markdown

from uasthn_cli.outputs.atomic import write_text


class Numbers(click.ParamType["tuple[float, ...]"]):
    """Numbers above 0 with commas between them."""

    name = "N,N…"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the numbers."""
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            numbers = ()
        if not numbers or min(numbers) <= 0:
            self.fail(f"{value}: give numbers above 0 with commas between them", param, ctx)
        return numbers


@click.command()
@flight_arguments
@click.option(
    "--only",
    type=click.Choice(GROUPS),
    multiple=True,
    default=GROUPS,
    help="Which rows; several times.  [default: all]",
)
@click.option("--repeat", "repeats", type=click.IntRange(min=1), default=3, show_default=True)
@click.option("--before", help="How an older version starts: an executable, or PYTHON -m MODULE.")
@click.option(
    "--before-path",
    type=click.Path(exists=True, path_type=Path),
    help="Where Python finds the older version's module.  [default: where it is installed]",
)
@click.option("--before-threads", type=click.IntRange(min=1), default=1, show_default=True)
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Threads of the libraries in every other run; --jobs comes on top.",
)
@click.option("--geotag", "options", default="", help="Further options of every geotag run.")
@click.option("--paper-frames", type=click.IntRange(min=2), default=4, show_default=True)
@click.option("--reach", type=Numbers(), default="100,200,400,800,2000", show_default=True)
@click.option("--flat-frames", type=Numbers(), default="100,1000,5000", show_default=True)
@click.option(
    "--flat-flights",
    type=click.Path(path_type=Path),
    help="Folder of these flights, named by their frames; those missing are rendered into it."
    "  [default: a temporary one]",
)
@click.option("--map-gb", type=click.FloatRange(min=0, min_open=True), default=20.0)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/benchmarks"),
    show_default=True,
    help="Folder for speed.csv and speed.md.",
)
def main(
    folders: tuple[Path, ...],
    hfovs_deg: tuple[float, ...],
    radii_m: tuple[float, ...],
    only: tuple[str, ...],
    repeats: int,
    before: str | None,
    before_path: Path | None,
    before_threads: int,
    threads: int,
    options: str,
    paper_frames: int,
    reach: tuple[float, ...],
    flat_frames: tuple[float, ...],
    flat_flights: Path | None,
    map_gb: float,
    out: Path,
) -> None:
    """Measure what geo-tagging takes."""
    each_deg = each("--hfov", hfovs_deg, folders)
    each_m = each("--search-radius", radii_m, folders)
    flights = [flight_of(*one) for one in zip(folders, each_deg, each_m, strict=True)]
    found: list[Figures] = []
    with tempfile.TemporaryDirectory() as temporary:
        plan = Plan(
            flights=flights,
            groups=frozenset(only),
            after=installed(threads),
            before=None if before is None else older(before, before_path, before_threads),
            folder=Path(temporary),
            radii_m=reach,
            flat_frames=[int(count) for count in flat_frames],
            flat_folder=flat_flights and flat_flights.absolute(),
            map_gigabytes=map_gb,
            paper_frames=paper_frames,
            options=tuple(shlex.split(options)),
        )
        for number, cases in enumerate(batches(plan)):
            runs = plan.folder / f"runs-{number}"
            found += measure(cases, repeats, runs, lambda line: click.echo(line, err=True))
            _write(found, threads, out)
    click.echo(as_markdown(found, threads), nl=False)
    if any(figures.error for figures in found):
        sys.exit(1)


def _write(found: list[Figures], threads: int, out: Path) -> None:
    """Write what is known so far: a long measurement that is stopped leaves something behind."""
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "speed.csv", as_csv(found))
    write_text(out / "speed.md", as_markdown(found, threads))


if __name__ == "__main__":
    main()
