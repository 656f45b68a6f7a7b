"""Does the tool know that it does not know? Flights made wrong, and what is still accepted.

    python benchmarks/stress.py [FLIGHT_DIR…] [--kind farms …] [--wrong-place N] [--donor TIF …]

A flight is a folder with ``flight.tlog``, ``frames/``, ``map.tif`` and ``truth.csv``; without any,
flights are rendered. Each is geo-tagged by ``uasthn geotag`` as it is, in every category and
severity of ``uasthn synth --stress``, and over maps of other places.
"""

import csv
import io
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from scipy.stats import binomtest
from tables import machine_line, markdown_table, number, use_threads

from uasthn_cli.commands.console import Verbosity, set_verbosity
from uasthn_cli.commands.geotag import geotag
from uasthn_cli.errors import MapElsewhereError
from uasthn_cli.outputs.atomic import write_text
from uasthn_cli.report.load import load_run
from uasthn_cli.synth.flight import render_flight
from uasthn_cli.synth.flight_config import FlightConfig, StressConfig
from uasthn_cli.synth.flight_folder import flight_in
from uasthn_cli.synth.kinds import LandscapeKind, StressCategory
from uasthn_cli.synth.stress import ON_MAP_COLUMN, stress_flight

TOLERANCE_M = 25.0
HEALTHY = "healthy"
NO_OVERLAP = "map-elsewhere"
CONFIDENCE = 0.95

CATEGORIES = tuple(name for name in StressCategory if name is not StressCategory.WRONG_PLACE)
SEVERITIES = (0.33, 0.67, 1.0)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of frames; ``found`` of the accepted are within 25 m of the truth."""

    frames: int = 0
    accepted: int = 0
    found: int = 0
    reasons: Counter[str] = field(default_factory=Counter)

    def __add__(self, other: "Outcome") -> "Outcome":
        """Return both together."""
        return Outcome(
            self.frames + other.frames,
            self.accepted + other.accepted,
            self.found + other.found,
            self.reasons + other.reasons,
        )

    def upper_bound(self) -> float:
        """Return the one-sided 95 % Clopper–Pearson bound of the accepted share."""
        test = binomtest(self.accepted, self.frames, alternative="less")
        return float(test.proportion_ci(CONFIDENCE, method="exact").high)


@dataclass(frozen=True, slots=True)
class Entry:
    """One flight in one category at one severity."""

    flight: str
    category: str
    severity: float
    seed: int
    outcome: Outcome


def measure(folder: Path, options: Sequence[str]) -> Outcome:
    """Geo-tag a flight as a user would, and count what became of its frames.

    Of a flight beyond its map only the frames that the map does not show whole are counted.
    """
    flight, counted = flight_in(folder), _counted_frames(folder)
    with TemporaryDirectory() as scratch:
        out = Path(scratch) / "out"
        inputs = [flight.log, flight.frames, "--map", flight.map, "--truth", flight.truth]
        try:
            geotag.main([*map(str, [*inputs, "--out", out]), *options], standalone_mode=False)
        except MapElsewhereError:
            return Outcome(len(counted), reasons=Counter({NO_OVERLAP: len(counted)}))
        rows = [row for row in load_run(out).rows if row.frame in counted]
    accepted = [row for row in rows if row.accepted]
    found = sum(row.ce_m <= TOLERANCE_M for row in accepted)
    reasons = Counter(row.reason for row in rows if not row.accepted)
    return Outcome(len(rows), len(accepted), found, reasons)


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


def as_markdown(entries: Sequence[Entry], threads: int) -> str:
    """Return the tables: categories by flight, wrong places by flight, and the machine."""
    stressed = [entry for entry in entries if entry.category != StressCategory.WRONG_PLACE]
    misplaced = [entry for entry in entries if entry.category == StressCategory.WRONG_PLACE]
    parts = [_stress_table(stressed)] if stressed else []
    if misplaced:
        parts.append(_wrong_place_table(misplaced))
    return "\n\n".join([*parts, machine_line(threads)]) + "\n"


def as_csv(entries: Iterable[Entry]) -> str:
    """Return one row per flight, category, severity and seed."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    counts = ("frames", "accepted", "accepted_within_25m", "reasons")
    writer.writerow(("flight", "category", "severity", "seed", *counts))
    for entry in entries:
        outcome = entry.outcome
        numbers = (outcome.frames, outcome.accepted, outcome.found, _reasons(outcome))
        writer.writerow((entry.flight, entry.category, entry.severity, entry.seed, *numbers))
    return text.getvalue()


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
    with TemporaryDirectory() as scratch:
        wanted = kinds or (() if flights else ("farms", "dunes"))
        configs = [FlightConfig(flight_seed, LandscapeKind(kind), frames) for kind in wanted]
        rendered = [Path(scratch) / f"{config.kind}-{flight_seed}" for config in configs]
        for folder, config in zip(rendered, configs, strict=True):
            render_flight(folder, config)
        every = [*flights, *rendered]
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


def _stressed(folder: Path, config: StressConfig, options: Sequence[str]) -> Outcome:
    with TemporaryDirectory() as scratch:
        variant = Path(scratch) / "flight"
        stress_flight(folder, variant, config)
        return measure(variant, options)


def _counted_frames(folder: Path) -> set[str]:
    """Return the frames that the truth knows and the map does not show whole, if it tells that."""
    with flight_in(folder).truth.open(encoding="utf-8-sig", newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {row["frame"] for row in rows if float(row.get(ON_MAP_COLUMN, 0.0)) < 1.0}


def _stress_table(entries: Sequence[Entry]) -> str:
    columns = (
        *("category", "severity", "flight", "frames", "accepted", "rejected"),
        *("of accepted within 25 m", "accepted and wrong", "why not accepted"),
    )
    rows = []
    for flight, category, severity in dict.fromkeys(
        (entry.flight, entry.category, entry.severity) for entry in entries
    ):
        own = [
            e for e in entries if (e.flight, e.category, e.severity) == (flight, category, severity)
        ]
        outcome = _sum(own)
        rows.append([category, f"{severity:g}", flight, *_shares(outcome)])
    return markdown_table(columns, rows)


def _wrong_place_table(entries: Sequence[Entry]) -> str:
    columns = ("wrong place", "maps", "frames", "accepted", "share", "95 % upper bound")
    by_flight = {
        flight: [entry for entry in entries if entry.flight == flight]
        for flight in dict.fromkeys(entry.flight for entry in entries)
    }
    rows = []
    for name, own in [*by_flight.items(), ("all", list(entries))]:
        outcome = _sum(own)
        counts = [str(len(own)), str(outcome.frames), str(outcome.accepted)]
        share = outcome.accepted / max(outcome.frames, 1)
        rows.append([name, *counts, number(share, 4), number(outcome.upper_bound(), 4)])
    return markdown_table(columns, rows)


def _shares(outcome: Outcome) -> list[str]:
    if not outcome.frames:
        return ["0", *["–"] * 4, ""]
    accepted = outcome.accepted / outcome.frames
    found = outcome.found / outcome.accepted if outcome.accepted else None
    wrong = (outcome.accepted - outcome.found) / outcome.frames
    figures = (accepted, 1.0 - accepted, found, wrong)
    return [str(outcome.frames), *(number(figure, 2) for figure in figures), _reasons(outcome)]


def _sum(entries: Iterable[Entry]) -> Outcome:
    return sum((entry.outcome for entry in entries), Outcome())


def _reasons(outcome: Outcome) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in outcome.reasons.most_common())


def _line(entry: Entry) -> str:
    outcome = entry.outcome
    return (
        f"{entry.flight}: {entry.category} {entry.severity:g} (seed {entry.seed}):"
        f" {outcome.accepted} of {outcome.frames} accepted, {outcome.found} within 25 m"
    )


if __name__ == "__main__":
    main()
