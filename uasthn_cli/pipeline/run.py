"""Open the inputs of a run and walk its frames."""

import logging
import math
import os
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from uasthn_cli.config import (
    GSD_STEP,
    MAX_MAP_ENLARGEMENT,
    NEAR_WIDTH_PX,
    ORIGIN_STEP_DEG,
    THERMAL_WIDTH_PX,
    UeMethod,
)
from uasthn_cli.errors import NoPositionError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.ingest.frames import UnreadableFrameError, frame_size_px, list_frames
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.ingest.priors import PriorSet, build_priors
from uasthn_cli.ingest.telemetry import Telemetry
from uasthn_cli.mapping.feature_store import open_store
from uasthn_cli.mapping.reader import MapReader, native_gsd_m
from uasthn_cli.mapping.tiles import EncodingCache, FeatureTiles
from uasthn_cli.pipeline.estimators import (
    open_base,
    open_members,
    open_near,
    says_deviations,
    settled_uncertainty,
)
from uasthn_cli.pipeline.flight_stage import FlightStage, RebuildPriors, Survey
from uasthn_cli.pipeline.frame_stage import FrameStage
from uasthn_cli.pipeline.fused_fixes import fused_results
from uasthn_cli.pipeline.job import GeotagJob, chosen_calibration, chosen_jobs, chosen_uncertainty
from uasthn_cli.pipeline.judge import Judge
from uasthn_cli.pipeline.look import Looker
from uasthn_cli.pipeline.parallel import in_order, one_core_each
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.seam import CacheableEncoder, Estimator
from uasthn_cli.types import (
    CameraModel,
    FloatArray,
    FrameFailure,
    FrameFile,
    FrameResult,
    Located,
    NearLook,
    Prior,
)
from uasthn_cli.uncertainty.methods import UncertaintyChoice

_T = TypeVar("_T")
_R = TypeVar("_R")

_FINER = 0.8
"""A grid for the second look must be this much finer than the search's to be worth having."""

_log = logging.getLogger(__name__)


class Run:
    """An opened run: priors are known, the map is open, the estimator is loaded.

    Its steps, which :func:`uasthn_cli.pipeline.driver.drive` takes: frames are located one by one
    (:meth:`locate`); with fusion, :meth:`survey` then settles the flight, :meth:`look_again` looks
    at each frame near where it settled, and :meth:`fuse` ends it.
    """

    def __init__(
        self,
        job: GeotagJob,
        priors: PriorSet,
        rebuild: RebuildPriors,
        lookers: tuple[Looker, Looker],
        uncertainty: UncertaintyChoice,
        map_crs: str,
        map_pixel_m: float,
        timer: StageTimer,
    ) -> None:
        """Wire the stages together; ``lookers`` see the wide search and what is near."""
        self.priors, self.map_crs, self._timer = priors, map_crs, timer
        self.camera, self.fuses, self._jobs = job.camera, job.config.fuse, chosen_jobs(job)
        self._shares_out = job.spec.works_in_processes
        self._wide, self._near = lookers
        self.calibration = chosen_calibration(job)
        self._judge = Judge(job.config, self.calibration, map_pixel_m)
        self._map_pixel_m = map_pixel_m
        self._uncertainty = uncertainty
        self._stage = FrameStage(self._wide, self._judge, job.config, uncertainty)
        self._flight = FlightStage(self._wide, self._near, self._stage.offset_grid, rebuild)

    @property
    def names(self) -> list[str]:
        """Names of the frames in their order, readable or not."""
        return [entry.frame.name for entry in self.priors.results]

    @property
    def timings(self) -> dict[str, float]:
        """Seconds spent per stage so far."""
        return self._timer.seconds

    def locate(self, skip: Container[str] = ()) -> Iterator[Located]:
        """Yield what each frame gives alone, in frame order, without those in ``skip``."""
        entries = (entry for entry in self.priors.results if entry.frame.name not in skip)
        yield from self._in_order(self._located, entries)

    def _in_order(self, function: Callable[[_T], _R], items: Iterable[_T]) -> Iterator[_R]:
        """Yield ``function`` of each item, computed by several processes, whose time counts too."""

        def timed(item: _T) -> tuple[_R, int, dict[str, float]]:
            before_s = dict(self._timer.seconds)
            result = function(item)
            spent_s = {k: s - before_s.get(k, 0.0) for k, s in self._timer.seconds.items()}
            return result, os.getpid(), spent_s

        with one_core_each() if self._shares_out else nullcontext():
            for result, process, spent_s in in_order(timed, items, self._jobs):
                if process != os.getpid():
                    self._timer.add(spent_s)
                yield result

    def _located(self, entry: Prior | FrameFailure) -> Located:
        return self._stage.locate(entry) if isinstance(entry, Prior) else Located(entry, None)

    def survey(self, located: Iterable[Located]) -> Survey | None:
        """Settle the flight from what its frames gave alone; None where they say nothing."""
        with self._timer.stage("fuse"):
            return self._flight.survey(located)

    def look_again(self, survey: Survey, skip: Container[str] = ()) -> Iterator[NearLook]:
        """Yield what each frame shows near where the flight has it, leaving out ``skip``."""
        indices = (
            index for index, frame in enumerate(survey.frames) if frame.prior.frame.name not in skip
        )
        yield from self._in_order(partial(self._flight.look_again, survey), indices)

    def fuse(
        self, located: Iterable[Located], survey: Survey, near: Mapping[str, NearLook]
    ) -> list[FrameResult]:
        """Return the flight's answers, in the order of ``located``."""
        with self._timer.stage("fuse"):
            looks = (near[frame.prior.frame.name] for frame in survey.frames)
            return fused_results(
                located, survey, looks, self._flight.near_grid, self._judge, self._wide
            )

    def describe(self) -> dict[str, Any]:
        """Return what was chosen for this run, ready for ``run.json``."""
        return {
            "time_base": {
                "base": str(self.priors.time_base.base),
                "why": self.priors.time_base.why,
            },
            "frame_times": self.priors.frame_times.why,
            "height_source": self.priors.height_source,
            "estimator": self._wide.estimator.name,
            "uncertainty": self._described_uncertainty(),
            "map_pixel_m": round(self._map_pixel_m, 6),
            "map_gsd_m": round(self._wide.grid.gsd_m, 6),
            "near_map_gsd_m": round(self._near.grid.gsd_m, 6),
            "local_origin": {"lat": self._wide.local.lat_deg, "lon": self._wide.local.lon_deg},
        }

    def _described_uncertainty(self) -> dict[str, Any]:
        """Return by which method uncertainties were told, and from how many answers."""
        chosen = self._uncertainty
        return {
            "method": chosen.method,
            "aggregation": chosen.aggregation,
            "merge": chosen.merge if chosen.method is UeMethod.CROPTTA_DE else None,
            "views": self._stage.crops.views,
            "members": self._wide.members,
        }


@contextmanager
def open_run(job: GeotagJob, estimator: Estimator | None = None) -> Iterator[Run]:
    """Read the log, list the frames, open the map and load the estimator, or take the one given.

    Raises:
        UasthnError: an input cannot be used; each class has its exit code.
        ValueError: what the job asks for contradicts itself.
    """
    job = replace(job, calibration=chosen_calibration(job, is_given=estimator is not None))
    has_head = None if estimator is None else says_deviations(estimator)
    chosen_uncertainty(job, has_head=has_head)
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
    local = _shared_frame(positions)
    with ExitStack() as stack:
        native_m = native_gsd_m(job.map_path, local)
        wide_m, near_m = _choose_gsds_m(job, located, native_m)
        wide_map = stack.enter_context(MapReader(job.map_path, local, wide_m))
        wide_map.require_overlap(positions, job.config.search_radius_m)
        if job.cache_dir is None and chosen_jobs(job) > 1:
            # processes find there what another has made of the map
            shared = stack.enter_context(TemporaryDirectory(prefix="uasthn-features-"))
            job = replace(job, cache_dir=Path(shared))
        second = None
        scale = None if estimator else job.spec.second_scale
        if scale is not None:
            second_map = stack.enter_context(MapReader(job.map_path, local, scale * wide_m))
            again = open_base(job, symmetries=1, second_scale=True)
            second = _looker(job, second_map, again, local, timer)
        base = estimator or open_base(job)
        uncertainty = settled_uncertainty(job, base)
        near = _looker(job, wide_map, base, local, timer)
        members = [_looker(job, wide_map, one, local, timer) for one in open_members(job)]
        wide = near.beside(second).with_members(members)
        if job.config.fuse and near_m < _FINER * wide_m:
            near_map = stack.enter_context(MapReader(job.map_path, local, near_m))
            again = estimator or open_near(job, base)
            near = _looker(job, near_map, again, local, timer)
        rebuild = partial(_rebuilt_priors, telemetry, frames, job, priors)
        crs = wide_map.place.crs_wkt
        yield Run(job, priors, rebuild, (wide, near), uncertainty, crs, native_m, timer)


def _looker(
    job: GeotagJob,
    reader: MapReader,
    estimator: Estimator,
    local: LocalFrame,
    timer: StageTimer,
) -> Looker:
    cache = None
    if job.cache_dir is not None and isinstance(estimator, CacheableEncoder):
        cache = EncodingCache(open_store(job.cache_dir), estimator, reader.grid, reader.content_id)
    tiles = FeatureTiles(
        timer.timed("map", reader.read),
        timer.timed("features", estimator.encode_map),
        stride_px=estimator.stride_px,
        halo_px=estimator.halo_px,
        cache=cache,
    )
    return Looker(job.camera, reader.grid, tiles, estimator, local, timer)


def _rebuilt_priors(
    telemetry: Telemetry,
    frames: list[FrameFile],
    job: GeotagJob,
    priors: PriorSet,
    added_s: float,
) -> dict[str, Prior]:
    """Return priors by frame name with ``added_s`` on the frames' times, by the clock chosen."""
    config = replace(
        job.prior,
        time_base=priors.time_base.base,
        time_offset_s=job.prior.time_offset_s + added_s,
    )
    rebuilt = build_priors(telemetry, frames, config=config, frame_times_csv=job.frame_times_csv)
    return {entry.frame.name: entry for entry in rebuilt.results if isinstance(entry, Prior)}


def _choose_gsds_m(job: GeotagJob, priors: list[Prior], native_m: float) -> tuple[float, float]:
    """Return the GSD of the search and of the second look.

    Each is a power of ``GSD_STEP``, or a share of the map's own pixels where these are coarser.
    The search sees a frame about 96 px wide, at most twice as fine as the map's own pixels
    (enlarging a coarse map helps: features come at half the image's resolution); the second look
    256 px wide, at most as fine as the map.
    """
    camera = _first_camera(job, priors)
    height_m = float(np.median([prior.height_above_ground_m for prior in priors]))
    footprint_m = height_m * camera.width_px / camera.focal_x_px
    wide_m = max(native_m / MAX_MAP_ENLARGEMENT, _shared_gsd_m(footprint_m / THERMAL_WIDTH_PX))
    near_m = max(native_m, _shared_gsd_m(footprint_m / NEAR_WIDTH_PX))
    return job.config.gsd_m or wide_m, near_m


def _shared_frame(positions_deg: FloatArray) -> LocalFrame:
    """Return the local frame of a flight's area: other flights there see the map on the same grid.

    What one of them kept of the map is then of use to the next.
    """
    latitude, longitude = np.median(positions_deg, axis=0) / ORIGIN_STEP_DEG
    return LocalFrame(round(latitude) * ORIGIN_STEP_DEG, round(longitude) * ORIGIN_STEP_DEG)


def _shared_gsd_m(gsd_m: float) -> float:
    """Return the nearest resolution that flights of about the same height share."""
    return float(GSD_STEP ** round(math.log(gsd_m, GSD_STEP)))


def _first_camera(job: GeotagJob, priors: list[Prior]) -> CameraModel:
    for prior in priors:
        try:
            return job.camera.model_of_frame(prior.frame.path, *frame_size_px(prior.frame.path))
        except UnreadableFrameError as error:
            _log.debug("%s: %s", prior.frame.name, error)
    return job.camera.model(640, 512)
