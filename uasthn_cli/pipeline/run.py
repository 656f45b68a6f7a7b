"""Open the inputs of a run and walk its frames."""

import logging
from collections.abc import Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from uasthn_cli.config import MAX_MAP_ENLARGEMENT, THERMAL_WIDTH_PX, GeotagConfig, PriorConfig
from uasthn_cli.errors import NoPositionError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.ingest.frames import UnreadableFrameError, frame_size_px, list_frames
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.ingest.priors import PriorSet, build_priors
from uasthn_cli.mapping.reader import MapReader, native_gsd_m
from uasthn_cli.mapping.tiles import FeatureTiles
from uasthn_cli.matching.registry import open_estimator
from uasthn_cli.pipeline.frame_stage import FrameStage
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.types import CameraModel, Estimator, FrameResult, Prior

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class GeotagJob:
    """The inputs of one run."""

    log_path: Path
    frames_path: Path
    map_path: Path
    camera: CameraSpec
    prior: PriorConfig = field(default_factory=PriorConfig)
    frame_times_csv: Path | None = None
    config: GeotagConfig = field(default_factory=GeotagConfig)
    weights_path: Path | None = None


class Run:
    """An opened run: priors are known, the map is open, the estimator is loaded."""

    def __init__(
        self,
        job: GeotagJob,
        priors: PriorSet,
        reader: MapReader,
        estimator: Estimator,
        local: LocalFrame,
        timer: StageTimer,
    ) -> None:
        """Wire the stages together."""
        self.priors, self._reader, self._estimator = priors, reader, estimator
        self._job, self._local, self._timer = job, local, timer
        tiles = FeatureTiles(
            timer.timed("map", reader.read),
            timer.timed("features", estimator.encode_map),
            stride_px=estimator.stride_px,
            halo_px=estimator.halo_px,
        )
        self._stage = FrameStage(
            job.camera, reader.grid, tiles, estimator, local, job.config, timer
        )

    @property
    def frame_count(self) -> int:
        """Number of frames, readable or not."""
        return len(self.priors.results)

    @property
    def map_crs(self) -> str:
        """The map's own coordinate reference system, as WKT."""
        return self._reader.place.crs_wkt

    @property
    def timings(self) -> dict[str, float]:
        """Seconds spent per stage so far."""
        return self._timer.seconds

    def results(self, skip: Container[str] = ()) -> Iterator[FrameResult]:
        """Yield a result per frame in frame order, leaving out frames named in ``skip``."""
        for entry in self.priors.results:
            if entry.frame.name not in skip:
                yield self._stage.locate(entry) if isinstance(entry, Prior) else entry

    def describe(self) -> dict[str, Any]:
        """Return what was chosen for this run, ready for ``run.json``."""
        return {
            "time_base": {
                "base": str(self.priors.time_base.base),
                "why": self.priors.time_base.why,
            },
            "frame_times": self.priors.frame_times.why,
            "height_source": self.priors.height_source,
            "estimator": self._estimator.name,
            "map_gsd_m": round(self._reader.grid.gsd_m, 6),
            "local_origin": {"lat": self._local.lat_deg, "lon": self._local.lon_deg},
        }


@contextmanager
def open_run(job: GeotagJob, estimator: Estimator | None = None) -> Iterator[Run]:
    """Read the log, list the frames, open the map and load the estimator, or take the one given.

    Raises:
        UasthnError: an input cannot be used; each class has its exit code.
    """
    timer = StageTimer()
    frames = list_frames(job.frames_path)
    with timer.stage("log"):
        telemetry = read_telemetry(job.log_path)
        priors = build_priors(
            telemetry, frames, config=job.prior, frame_times_csv=job.frame_times_csv
        )
    located = [entry for entry in priors.results if isinstance(entry, Prior)]
    if not located:
        reasons = {entry.detail for entry in priors.results if not isinstance(entry, Prior)}
        raise NoPositionError(
            f"{job.log_path}: no frame has a position ({'; '.join(sorted(reasons)[:2])}); check "
            "--time-offset, --time-base and --frame-times"
        )
    positions = np.array([(prior.lat_deg, prior.lon_deg) for prior in located])
    local = LocalFrame(*np.median(positions, axis=0))
    gsd_m = job.config.gsd_m or _choose_gsd_m(job, located, local)
    with MapReader(job.map_path, local, gsd_m) as reader:
        reader.require_overlap(positions, job.config.search_radius_m)
        chosen = estimator or open_estimator(
            job.config.estimator,
            weights_path=job.weights_path,
            device=job.config.device,
            symmetries=job.config.symmetries,
        )
        yield Run(job, priors, reader, chosen, local, timer)


def _choose_gsd_m(job: GeotagJob, priors: list[Prior], local: LocalFrame) -> float:
    """Return the GSD at which a frame is about 96 px wide, at most twice as fine as the map's own.

    Enlarging a coarse map helps: features come at half the image's resolution.
    """
    camera = _first_camera(job, priors)
    height_m = float(np.median([prior.height_above_ground_m for prior in priors]))
    footprint_m = height_m * camera.width_px / camera.focal_x_px
    finest_m = native_gsd_m(job.map_path, local) / MAX_MAP_ENLARGEMENT
    return max(finest_m, footprint_m / THERMAL_WIDTH_PX)


def _first_camera(job: GeotagJob, priors: list[Prior]) -> CameraModel:
    for prior in priors:
        try:
            return job.camera.model_of_frame(prior.frame.path, *frame_size_px(prior.frame.path))
        except UnreadableFrameError as error:
            _log.debug("%s: %s", prior.frame.name, error)
    return job.camera.model(640, 512)
