"""The paper's failure cases (sec. IV-D) under its own rule: what a method rejects of them."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from uasthn_cli.config import TOLERANCE_M, UeMethod
from uasthn_cli.datasets.flights import FlightDataset
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.errors import DatasetError
from uasthn_cli.evaluation.judging import JudgingConfig, judge
from uasthn_cli.evaluation.predictions import Settings, gathered
from uasthn_cli.evaluation.protocol import ProtocolConfig, predict
from uasthn_cli.seam import Estimator
from uasthn_cli.synth.flight import render_flight
from uasthn_cli.synth.flight_config import FlightConfig, StressConfig
from uasthn_cli.synth.flight_folder import flight_in
from uasthn_cli.synth.kinds import LandscapeKind, StressCategory
from uasthn_cli.synth.stress import ON_MAP_COLUMN, stress_flight

HEALTHY: Final = "healthy"
CATEGORIES: Final = tuple(name for name in StressCategory if name is not StressCategory.WRONG_PLACE)
SEVERITIES: Final = (0.33, 0.67, 1.0)


@dataclass(frozen=True, slots=True)
class StressRow:
    """What became of one flight's frames in one category at one severity.

    Frames that show nothing to match count as rejected; of a flight beyond its map only those that
    the map does not show whole are counted. ``accepted_within`` is the share of accepted frames
    with a CE within the tolerance (None: none accepted).
    """

    flight: str
    category: str
    severity: float
    frames: int
    rejected_fraction: float
    accepted_within: float | None


@dataclass(frozen=True, slots=True)
class StressSuite:
    """Everything but the flights: who answers, how, and by which method answers are judged."""

    estimators: Sequence[Estimator]
    settings: Settings
    protocol: ProtocolConfig
    spec: DatasetSpec
    method: UeMethod
    judging: JudgingConfig
    tolerance_m: float = TOLERANCE_M

    def rows(
        self,
        flights: Sequence[Path],
        categories: Sequence[StressCategory] = CATEGORIES,
        severities: Sequence[float] = SEVERITIES,
    ) -> Iterator[StressRow]:
        """Yield each flight as it is, then in each category at each severity.

        Raises:
            UasthnError: a flight cannot be read, or not be changed so.
        """
        for index, folder in enumerate(flights):
            yield self._row(folder, folder.name, HEALTHY, 0.0)
            for category in categories:
                for severity in severities:
                    stress = StressConfig(category, severity, self.spec.seed + index)
                    with TemporaryDirectory() as scratch:
                        variant = Path(scratch) / "flight"
                        stress_flight(folder, variant, stress)
                        yield self._row(variant, folder.name, category, severity)

    def _row(self, folder: Path, flight: str, category: str, severity: float) -> StressRow:
        counted = _counted_frames(folder)
        try:
            samples = list(
                predict(FlightDataset(folder, self.spec), self.estimators, self.protocol)
            )
        except DatasetError:
            samples = []
        known = [sample for sample in samples if sample.name in counted]
        # with --samples only some frames are looked at
        frames = len(counted) if self.spec.samples is None else len(known)
        if not known:
            return StressRow(flight, category, severity, frames, 1.0, None)
        judged = judge(gathered(self.settings, known), self.method, self.judging)
        accepted_ce_m = judged.ce_m[judged.accepted]
        within = float(np.mean(accepted_ce_m <= self.tolerance_m)) if accepted_ce_m.size else None
        rejected = 1.0 - accepted_ce_m.size / frames
        return StressRow(flight, category, severity, frames, rejected, within)


def render_flights(folder: Path, frames: int, seed: int) -> list[Path]:
    """Render a flight over farms and one over dunes below a folder; return where they are."""
    paths = []
    for kind in (LandscapeKind.FARMS, LandscapeKind.DUNES):
        paths.append(folder / f"{kind}-{seed}")
        render_flight(paths[-1], FlightConfig(seed, kind, frames))
    return paths


def _counted_frames(folder: Path) -> set[str]:
    """Return the frames that truth.csv has, without those that a cut map still shows whole."""
    with flight_in(folder).truth.open(encoding="utf-8-sig", newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {row["frame"] for row in rows if float(row.get(ON_MAP_COLUMN, 0.0)) < 1.0}
