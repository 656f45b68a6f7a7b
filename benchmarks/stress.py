"""Does the tool know that it does not know? Flights made wrong, and what is still accepted.

    python benchmarks/stress.py [FLIGHT_DIR…] [--kind farms …] [--wrong-place N] [--donor TIF …]

A flight is a folder with ``flight.tlog``, ``frames/``, ``map.tif`` and ``truth.csv``; without any,
flights are rendered. Each is geo-tagged by ``uasthn geotag`` as it is, in every category and
severity of ``uasthn synth --stress``, and over maps of other places.
"""

import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from stress_outcomes import Entry, Outcome, as_csv, as_markdown, measure
from tables import use_threads

from uasthn_cli.commands.console import Verbosity, set_verbosity
from uasthn_cli.outputs.atomic import write_text
from uasthn_cli.synth.flight import render_flight
from uasthn_cli.synth.flight_config import FlightConfig, StressConfig
from uasthn_cli.synth.kinds import LandscapeKind, StressCategory
from uasthn_cli.synth.stress import stress_flight

HEALTHY = "healthy"

CATEGORIES = tuple(name for name in StressCategory if name is not StressCategory.WRONG_PLACE)
SEVERITIES = (0.33, 0.67, 1.0)


def stress_entries(
    flights: Sequence[Path],
    categories: Iterable[StressCategory],
    severities: Sequence[float],
    seeds: Sequence[int],
    options: Sequence[str],
) -> Iterator[Entry]:
    """Yield what becomes of each flight as it is, and in each category at each severity."""
    chosen = list(categories)
    for index, folder in enumerate(flights):
        yield Entry(folder.name, HEALTHY, 0.0, 0, measure(folder, options))
        for category in chosen:
            for severity in severities:
                for seed in seeds:
                    config = StressConfig(category, severity, seed + index)
                    outcome = _stressed(folder, config, options)
                    yield Entry(folder.name, category, severity, seed, outcome)


def wrong_place_entries(
    flights: Sequence[Path], least_frames: int, donors: tuple[Path, ...], options: Sequence[str]
) -> Iterator[Entry]:
    """Yield what becomes of flights over maps of other places, until so many frames are counted."""
    frames = seed = 0
    while frames < least_frames:
        folder = flights[seed % len(flights)]
        config = StressConfig(StressCategory.WRONG_PLACE, 1.0, seed, donors)
        entry = Entry(folder.name, config.category, 1.0, seed, _stressed(folder, config, options))
        frames += entry.outcome.frames
        seed += 1
        yield entry


@click.command()
@click.argument("flights", nargs=-1, type=click.Path(exists=True, path_type=Path))
@click.option(
    "--kind",
    "kinds",
    type=click.Choice([kind.value for kind in LandscapeKind]),
    multiple=True,
    help="Render a flight over this kind of place; farms and dunes if no flight is given.",
)
@click.option("--frames", type=int, default=24, show_default=True, help="Of a rendered flight.")
@click.option("--flight-seed", type=int, default=1, show_default=True, help="Which places.")
@click.option(
    "--category",
    "categories",
    type=click.Choice([category.value for category in CATEGORIES]),
    multiple=True,
    default=[category.value for category in CATEGORIES],
    help="Leave out for all.",
)
@click.option(
    "--severity",
    "severities",
    type=click.FloatRange(0, 1, min_open=True),
    multiple=True,
    default=SEVERITIES,
    show_default=True,
)
@click.option("--seed", "seeds", type=int, multiple=True, default=(0,), show_default=True)
@click.option(
    "--wrong-place",
    "wrong_place_frames",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="Also geo-tag at least N frames over maps of other places.",
)
@click.option("--only-wrong-place", is_flag=True, help="Leave the categories out.")
@click.option(
    "--donor",
    "donors",
    type=click.Path(exists=True, path_type=Path),
    multiple=True,
    help="GeoTIFF of another place for the wrong maps; rendered landscapes if there is none.",
)
@click.option(
    "--geotag",
    "geotag_options",
    default="--hfov 45",
    show_default=True,
    metavar="OPTIONS",
    help="Options of `uasthn geotag`, in quotes.",
)
@click.option("--threads", type=int, default=1, show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/benchmarks"),
    show_default=True,
    help="Folder for stress.csv and stress.md.",
)
def main(
    flights: tuple[Path, ...],
    kinds: tuple[str, ...],
    frames: int,
    flight_seed: int,
    categories: tuple[str, ...],
    severities: tuple[float, ...],
    seeds: tuple[int, ...],
    wrong_place_frames: int,
    only_wrong_place: bool,
    donors: tuple[Path, ...],
    geotag_options: str,
    threads: int,
    out: Path,
) -> None:
    """Count what is accepted of flights that are wrong in one way each."""
    set_verbosity(Verbosity.QUIET)
    use_threads(threads)
    options = shlex.split(geotag_options)
    entries: list[Entry] = []
    wanted = kinds or (() if flights else ("farms", "dunes"))
    with TemporaryDirectory() as scratch:
        every = [*flights, *_rendered(Path(scratch), wanted, frames, flight_seed)]
        asked = [] if only_wrong_place else [StressCategory(name) for name in categories]
        stressed = stress_entries(every, asked, severities, seeds, options)
        misplaced = wrong_place_entries(every, wrong_place_frames, donors, options)
        for part in (stressed, misplaced):
            for entry in part:
                click.echo(_line(entry), err=True)
                entries.append(entry)
    table = as_markdown(entries, threads)
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "stress.csv", as_csv(entries))
    write_text(out / "stress.md", table)
    click.echo(table, nl=False)


def _rendered(folder: Path, kinds: Iterable[str], frames: int, seed: int) -> Iterator[Path]:
    """Render a flight over each kind of place; yield their folders."""
    for kind in kinds:
        render_flight(folder / f"{kind}-{seed}", FlightConfig(seed, LandscapeKind(kind), frames))
        yield folder / f"{kind}-{seed}"


def _stressed(folder: Path, config: StressConfig, options: Sequence[str]) -> Outcome:
    with TemporaryDirectory() as scratch:
        variant = Path(scratch) / "flight"
        stress_flight(folder, variant, config)
        return measure(variant, options)


def _line(entry: Entry) -> str:
    outcome = entry.outcome
    return (
        f"{entry.flight}: {entry.category} {entry.severity:g} (seed {entry.seed}):"
        f" {outcome.accepted} of {outcome.frames} accepted, {outcome.found} within 25 m"
    )


if __name__ == "__main__":
    main()
