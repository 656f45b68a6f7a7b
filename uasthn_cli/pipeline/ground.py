"""Ground that rises and falls: priors and cameras over an elevation model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from uasthn_cli.config import DemDatum
from uasthn_cli.errors import MapElsewhereError
from uasthn_cli.geometry.camera import HorizonError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.surface import CameraOverSurface, FlatGround, Surface
from uasthn_cli.ingest.height import MIN_HEIGHT_M
from uasthn_cli.ingest.priors import PriorSet, commonest, on_the_ground
from uasthn_cli.types import CameraModel, FloatArray, FrameFailure, Prior

DEM_SOURCE: Final = "dem"
"""Source of heights over an elevation model."""

_FOOTPRINT_SAMPLES = 7


@dataclass(frozen=True, slots=True)
class Datum:
    """How the log's altitudes become heights of the elevation model, and why so.

    ``zero_m`` is the model's height of what the log's altitudes are counted from.
    """

    kind: DemDatum
    zero_m: float
    why: str

    def altitude_m(self, prior: Prior) -> float:
        """Return a camera's altitude in the model's datum, NaN where the log has none."""
        if self.kind is DemDatum.AMSL:
            return self.zero_m + prior.alt_amsl_m
        return self.zero_m + prior.above_start_m


@dataclass(frozen=True, slots=True)
class Ground:
    """The relief under a flight; ``camera`` is that of its frames, as far as footprints matter."""

    path: Path
    surface: Surface
    local: LocalFrame
    camera: CameraModel
    datum: Datum

    def settled(self, prior: Prior) -> Prior:
        """Return a prior whose height is that above the mean ground of its footprint.

        Unchanged where the model or the log has no height there.
        """
        altitude_m = self.datum.altitude_m(prior)
        position_m = self._position_m(prior)
        below_m = float(self.surface.heights_m(position_m))
        if not math.isfinite(altitude_m - below_m):
            return prior
        ground_m = self._mean_m(prior, position_m, altitude_m, below_m)
        return replace(
            prior,
            height_above_ground_m=altitude_m - ground_m,
            height_source=DEM_SOURCE,
            ground_m=ground_m,
        )

    def settled_set(self, priors: PriorSet) -> PriorSet:
        """Return all priors settled; what is on the ground then is a failure.

        Raises:
            MapElsewhereError: no frame's place has a height.
        """
        results = self.settled_results(priors)
        if not frames_over_relief(results):
            raise MapElsewhereError(
                f"{self.path}: the elevation model has no height below any frame; give one of the"
                " flight's area"
            )
        sources = [entry.height_source for entry in results if isinstance(entry, Prior)]
        return replace(priors, results=results, height_source=commonest(sources))

    def settled_results(self, priors: PriorSet) -> list[Prior | FrameFailure]:
        """Return the entries of :meth:`settled_set`."""
        return [_settled_result(self, entry) for entry in priors.results]

    def over(self, camera: CameraModel, prior: Prior) -> CameraOverSurface | None:
        """Return a frame's camera above the relief; None for one that keeps flat ground."""
        if prior.ground_m is None:
            return None
        return CameraOverSurface(
            camera=camera,
            attitude=prior.attitude,
            position_m=self._position_m(prior),
            altitude_m=prior.ground_m + prior.height_above_ground_m,
            surface=self.surface,
            plane_m=prior.ground_m,
        )

    def describe(self, results: Sequence[Prior | FrameFailure]) -> dict[str, Any]:
        """Return what heights rest on, ready for ``run.json``."""
        return {
            "datum": self.datum.kind,
            "zero_m": round(self.datum.zero_m, 3),
            "why": self.datum.why,
            "frames": frames_over_relief(results),
        }

    def line(self, results: Sequence[Prior | FrameFailure]) -> str:
        """Return in one line what heights rest on."""
        total, count = len(results), frames_over_relief(results)
        rest = "" if count == total else "; the others keep flat ground at the log's height"
        return (
            f"Heights over {self.path.name} for {count} of {total} frames{rest}; {self.datum.why}"
        )

    def _mean_m(
        self, prior: Prior, position_m: FloatArray, altitude_m: float, below_m: float
    ) -> float:
        """Return the mean height of a footprint's ground, as far as the model knows it."""
        if altitude_m - below_m < MIN_HEIGHT_M:
            return below_m
        plane = CameraOverSurface(
            self.camera, prior.attitude, position_m, altitude_m, FlatGround(below_m), below_m
        )
        x = np.linspace(0.0, self.camera.width_px - 1.0, _FOOTPRINT_SAMPLES)
        y = np.linspace(0.0, self.camera.height_px - 1.0, _FOOTPRINT_SAMPLES)
        try:
            places_m = plane.to_ground(np.stack(np.meshgrid(x, y), axis=-1))
        except HorizonError:
            return below_m
        heights_m = self.surface.heights_m(places_m)
        known_m = heights_m[np.isfinite(heights_m)]
        return float(known_m.mean()) if known_m.size else below_m

    def _position_m(self, prior: Prior) -> FloatArray:
        return self.local.to_metres(np.array([prior.lat_deg, prior.lon_deg]))


def frames_over_relief(results: Sequence[Prior | FrameFailure]) -> int:
    """Return how many priors have their height from the elevation model."""
    return sum(isinstance(entry, Prior) and entry.ground_m is not None for entry in results)


def _settled_result(ground: Ground, entry: Prior | FrameFailure) -> Prior | FrameFailure:
    """Return an entry settled; a failure for a prior that is on the ground."""
    if not isinstance(entry, Prior):
        return entry
    prior = ground.settled(entry)
    if prior.height_above_ground_m >= MIN_HEIGHT_M:
        return prior
    return on_the_ground(prior)
