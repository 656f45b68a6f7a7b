"""What becomes of a flight's frames when it is geo-tagged, counted and put in tables."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from scipy.stats import binomtest
from tables import machine_line, markdown_table, number

from uasthn_cli.commands.geotag import geotag
from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.errors import MapElsewhereError
from uasthn_cli.report.load import load_run
from uasthn_cli.synth.flight_folder import flight_in
from uasthn_cli.synth.kinds import StressCategory
from uasthn_cli.synth.stress import ON_MAP_COLUMN

NO_OVERLAP = "map-elsewhere"
CONFIDENCE = 0.95


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
