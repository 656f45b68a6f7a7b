"""Open an elevation model, and find what ties the log's altitudes to it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from uasthn_cli.config import DemDatum
from uasthn_cli.errors import MapElsewhereError, NoPositionError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.surface import Relief
from uasthn_cli.ingest.height import Start, start_of
from uasthn_cli.ingest.priors import PriorSet
from uasthn_cli.ingest.telemetry import Telemetry
from uasthn_cli.mapping.elevation import read_relief
from uasthn_cli.pipeline.ground import Datum, Ground
from uasthn_cli.pipeline.job import GeotagJob
from uasthn_cli.pipeline.matchers import first_camera, shared_frame
from uasthn_cli.types import FloatArray, Prior

_REACH_HEIGHTS: Final = 3.0
_REACH_MARGIN_M: Final = 200.0
_TAKE_OFF_REACH_M: Final = 100.0
_SAME_PLACE_M: Final = 20.0
"""Two heights of one place that differ by more, in about the same datum, are not of one place."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a log has to tie its heights to the model at ``path``.

    ``flight_m`` is the mean height of the model below the frames.
    """

    path: Path
    start: Start
    has_amsl: bool
    flight_m: float

    def amsl(self, why: str) -> Datum:
        """Return the log's altitudes above sea level, taken for the model's."""
        if not self.has_amsl:
            raise NoPositionError(
                f"{self.path}: --dem-datum amsl needs altitudes above sea level, which the log does"
                " not have: choose another"
            )
        return Datum(DemDatum.AMSL, 0.0, f"altitudes above sea level, {why}")

    def flight(self, why: str) -> Datum:
        """Return heights above ground that are the log's, on average."""
        text = f"the log's heights, taken to be right on the flight's average, {why}"
        return Datum(DemDatum.FLIGHT, self.flight_m, text)

    def take_off(self, ground_m: float) -> Datum:
        """Return the log's heights above the model's ground at take-off."""
        amsl_m = self.start.ground_amsl_m
        stated = f" (by the log {amsl_m:.1f} m above sea level)" if self.has_amsl else ""
        why = f"heights above take-off, where the model has {ground_m:.1f} m{stated}"
        return Datum(DemDatum.TAKE_OFF, ground_m, why)


def open_ground(job: GeotagJob, telemetry: Telemetry, priors: PriorSet) -> tuple[Ground, ...]:
    """Read the elevation model of a job around the flight.

    Returns nothing where the job has none; one ground, or two by rival datums, the likelier first,
    between which only the frames can tell.

    Raises:
        UasthnError: the model cannot be used, or heights cannot be tied to it as asked.
    """
    located = [entry for entry in priors.results if isinstance(entry, Prior)]
    path = job.prior.dem_path
    if path is None or not located:
        return ()
    positions = np.array([(prior.lat_deg, prior.lon_deg) for prior in located])
    local = shared_frame(positions)
    highest_m = max(max(prior.above_start_m, prior.height_above_ground_m) for prior in located)
    reach_m = job.config.search_radius_m + _REACH_HEIGHTS * highest_m + _REACH_MARGIN_M
    relief = read_relief(path, local, positions, reach_m)
    evidence = Evidence(
        path=path,
        start=start_of(telemetry),
        has_amsl=bool(np.isfinite(telemetry.positions.alt_amsl_m).any()),
        flight_m=_mean_below_m(path, relief, local.to_metres(positions)),
    )
    datums = choose_datums(job.prior.dem_datum, evidence)
    ground = Ground(path, relief, local, first_camera(job, located), datums[0])
    return tuple(replace(ground, datum=datum) for datum in datums)


def choose_datums(asked: DemDatum, evidence: Evidence) -> tuple[Datum, ...]:
    """Return how a log's heights become heights of the model: as asked, or by evidence.

    Differences to the ground at take-off need no common datum, so they come first wherever the log
    shows where take-off was and the model has a height there.

    Raises:
        NoPositionError: the log has not what was asked for.
        MapElsewhereError: the model has no height at take-off, and that is to be used.
    """
    if asked is DemDatum.AMSL:
        return (evidence.amsl("as asked"),)
    if asked is DemDatum.FLIGHT:
        return (evidence.flight("as asked"),)
    start = evidence.start
    ground_m = _height_at_m(evidence.path, start) if start.is_on_ground else None
    if asked is DemDatum.TAKE_OFF:
        _require_take_off(evidence, ground_m)
    if ground_m is not None:
        apart_m = abs(start.ground_amsl_m - ground_m)
        if asked is DemDatum.TAKE_OFF or not (start.is_assumed and apart_m > _SAME_PLACE_M):
            return (evidence.take_off(ground_m),)
    why = "as the log does not show the ground at take-off"
    if start.is_on_ground and ground_m is None:
        why = "as the model has no height at take-off"
    flight = evidence.flight(why)
    return (evidence.amsl(why), flight) if evidence.has_amsl else (flight,)


def _require_take_off(evidence: Evidence, ground_m: float | None) -> None:
    """Check that the height of the ground at take-off is known."""
    start = evidence.start
    if not start.is_on_ground:
        raise NoPositionError(
            f"{evidence.path}: --dem-datum take-off needs the place of take-off, but the log starts"
            f" {start.height_m:.0f} m above it: choose another"
        )
    if ground_m is None:
        raise MapElsewhereError(
            f"{evidence.path}: the elevation model has no height at take-off"
            f" ({start.lat_deg:.5f}, {start.lon_deg:.5f}): choose another --dem-datum"
        )


def _height_at_m(path: Path, start: Start) -> float | None:
    """Return the model's height where a log starts; None where it has none."""
    local = LocalFrame(start.lat_deg, start.lon_deg)
    place = np.array([[start.lat_deg, start.lon_deg]])
    try:
        height_m = float(read_relief(path, local, place, _TAKE_OFF_REACH_M).heights_m(np.zeros(2)))
    except MapElsewhereError:
        return None
    return height_m if np.isfinite(height_m) else None


def _mean_below_m(path: Path, relief: Relief, positions_m: FloatArray) -> float:
    heights_m = relief.heights_m(positions_m)
    known_m = heights_m[np.isfinite(heights_m)]
    if not known_m.size:
        raise MapElsewhereError(
            f"{path}: the elevation model has no height below any frame; give one of the flight's"
            " area"
        )
    return float(known_m.mean())
