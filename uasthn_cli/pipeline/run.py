"""Open the inputs of a run and walk its frames."""

import math
import os
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from uasthn_cli.config import PriorConfig, UeMethod
from uasthn_cli.errors import NoPositionError
from uasthn_cli.fusion.pose_smoother import SmoothedPoses
from uasthn_cli.ingest.frames import list_frames
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.ingest.priors import PriorSet, build_priors, look_up
from uasthn_cli.ingest.telemetry import Telemetry
from uasthn_cli.mapping.reader import native_gsd_m
from uasthn_cli.matching.spec import WeightsUse
from uasthn_cli.pipeline.datum_trial import likeliest_ground
from uasthn_cli.pipeline.diagnosis import Diagnosis, diagnose, is_needed
from uasthn_cli.pipeline.estimators import (
    open_base,
    open_refine_estimator,
    refine_symmetries,
    says_deviations,
    settled_uncertainty,
    with_settled_device,
)
from uasthn_cli.pipeline.flight_poses import settled_poses
from uasthn_cli.pipeline.flight_stage import FlightStage, FusedFlight
from uasthn_cli.pipeline.frame_matcher import FrameMatcher
from uasthn_cli.pipeline.frame_stage import FrameStage
from uasthn_cli.pipeline.fused_fixes import fused_results
from uasthn_cli.pipeline.ground import Ground
from uasthn_cli.pipeline.job import (
    GeotagJob,
    chosen_calibration,
    chosen_jobs,
    chosen_uncertainty,
    settled_jobs,
)
from uasthn_cli.pipeline.matchers import MatcherBuilder, choose_gsds_m, shared_frame
from uasthn_cli.pipeline.open_ground import open_ground
from uasthn_cli.pipeline.parallel import in_order, one_core_each
from uasthn_cli.pipeline.pose_observations import RebuildPriors
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.pipeline.trials import Trials, tried_and_control
from uasthn_cli.pipeline.trust_model import TrustModel
from uasthn_cli.seam import Estimator
from uasthn_cli.types import (
    FrameFailure,
    FrameFile,
    FrameResult,
    Located,
    Prior,
    RefinedFrame,
)
from uasthn_cli.uncertainty.methods import UncertaintyChoice

_T = TypeVar("_T")
_R = TypeVar("_R")

_FINER = 0.8
"""A grid for the refinement must be this much finer than the search's to be worth having."""


@dataclass(frozen=True, slots=True)
class LoggedFlight:
    """What the log says of a flight's frames, over the relief below them; None: ground is flat."""

    priors: PriorSet
    rebuild: RebuildPriors
    ground: Ground | None


class Run:
    """An opened run: priors are known, the map is open, the estimator is loaded.

    Its steps, which :func:`uasthn_cli.pipeline.driver.drive` takes: frames are located one by one
    (:meth:`locate`); with fusion, :meth:`fuse_flight` then settles the flight, :meth:`refine`
    matches each frame again near where it settled, :meth:`settle_poses` says how the camera was
    turned, and :meth:`place_frames` ends it.
    """

    def __init__(
        self,
        job: GeotagJob,
        flight: LoggedFlight,
        matchers: tuple[FrameMatcher, FrameMatcher],
        uncertainty: UncertaintyChoice,
        map_crs: str,
        map_pixel_m: float,
        timer: StageTimer,
    ) -> None:
        """Wire the stages together; ``matchers`` search, and refine near a known place."""
        self.priors, self.ground, self._rebuild = flight.priors, flight.ground, flight.rebuild
        self.map_crs, self._timer, self._job = map_crs, timer, job
        self.camera, self.fuses, self.jobs = job.camera, job.config.fuse, settled_jobs(job)
        self._search_matcher, self._refine_matcher = matchers
        self._attitude_error_rad = math.radians(job.config.attitude_error_deg)
        self.calibration = chosen_calibration(job)
        self._trust_model = TrustModel(job.config, self.calibration, map_pixel_m)
        self._map_pixel_m = map_pixel_m
        self._uncertainty = uncertainty
        self._frame_stage = FrameStage(
            self._search_matcher, self._trust_model, job.config, uncertainty
        )
        self._flight_stage = FlightStage(
            self._search_matcher,
            self._refine_matcher,
            self._frame_stage.offset_grid,
            flight.rebuild,
            flight.ground,
            self._attitude_error_rad,
        )

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

        with one_core_each() if self._job.spec.works_in_processes else nullcontext():
            for result, process, spent_s in in_order(timed, items, self.jobs):
                if process != os.getpid():
                    self._timer.add(spent_s)
                yield result

    def _located(self, entry: Prior | FrameFailure) -> Located:
        return self._frame_stage.locate(entry) if isinstance(entry, Prior) else Located(entry, None)

    def fuse_flight(self, located: Iterable[Located]) -> FusedFlight | None:
        """Settle the flight from what its frames gave alone; None where they say nothing."""
        with self._timer.stage("fuse"):
            return self._flight_stage.fuse(located)

    def refine(self, flight: FusedFlight, skip: Container[str] = ()) -> Iterator[RefinedFrame]:
        """Yield what each frame shows near where the flight has it, leaving out ``skip``."""
        indices = (
            index for index, frame in enumerate(flight.frames) if frame.prior.frame.name not in skip
        )
        yield from self._in_order(partial(self._flight_stage.refine, flight), indices)

    def place_frames(
        self,
        located: Iterable[Located],
        flight: FusedFlight,
        refined: Mapping[str, RefinedFrame],
        poses: SmoothedPoses | None = None,
    ) -> list[FrameResult]:
        """Return the flight's answers, in the order of ``located``; ``poses`` None: as logged."""
        with self._timer.stage("fuse"):
            return fused_results(
                located,
                flight,
                _in_flight(flight, refined),
                self._flight_stage.refine_grid,
                self._trust_model,
                self._search_matcher.local,
                self.ground,
                poses,
            )

    def settle_poses(
        self, flight: FusedFlight, refined: Mapping[str, RefinedFrame]
    ) -> SmoothedPoses | None:
        """Return what the flight's frames say of the camera's attitude; None: too little."""
        return settled_poses(
            flight,
            _in_flight(flight, refined),
            self._refine_matcher,
            self._rebuild,
            self._attitude_error_rad,
            self.ground,
        )

    def diagnose(self, results: Sequence[FrameResult]) -> Diagnosis | None:
        """Return what the frames fit under, where hardly one was accepted; None elsewhere."""
        if not (self.fuses and self._job.spec.scores_shifts and is_needed(results)):
            return None
        names = [entry.frame.name for entry in self.priors.results if isinstance(entry, Prior)]
        grid, radius_m = self._frame_stage.offset_grid, self._job.config.search_radius_m
        tried, control = (
            Trials(self._search_matcher, grid, some, self._rebuild, radius_m)
            for some in tried_and_control(names)
        )
        with self._timer.stage("diagnose"):
            return diagnose(tried, control if control.frames else None)

    def describe(self) -> dict[str, Any]:
        """Return what was chosen for this run, ready for ``run.json``."""
        local, spec = self._search_matcher.local, self._job.spec
        times = self.priors.frame_times
        return {
            "time_base": {
                "base": str(self.priors.time_base.base),
                "why": self.priors.time_base.why,
            },
            "frame_times": times.why,
            "pairing": times.pairing and times.pairing.describe(self.names),
            "height_source": self.priors.height_source,
            "altitude_source": self.priors.altitude_source,
            "attitude_source": self.priors.attitude_source,
            "ground": self.ground and self.ground.describe(self.priors.results),
            "estimator": self._search_matcher.estimator.name,
            "uncertainty": self._described_uncertainty(),
            "map_pixel_m": round(self._map_pixel_m, 6),
            "map_gsd_m": round(self._search_matcher.grid.gsd_m, 6),
            "refine_map_gsd_m": round(self._refine_matcher.grid.gsd_m, 6),
            "refine_symmetries": self._refine_symmetries,
            "device": None if spec.weights is WeightsUse.NONE else self._job.config.device,
            "local_origin": {"lat": local.lat_deg, "lon": local.lon_deg},
        }

    @property
    def _refine_symmetries(self) -> int | None:
        """In how many orientations frames are refined; None where they are not, or take but one."""
        if not self.fuses:
            return None
        gsds_m = (matcher.grid.gsd_m for matcher in (self._refine_matcher, self._search_matcher))
        return refine_symmetries(self._job, is_finer=_is_finer(*gsds_m))

    def _described_uncertainty(self) -> dict[str, Any]:
        """Return by which method uncertainties were told, and from how many answers."""
        chosen = self._uncertainty
        return {
            "method": chosen.method,
            "aggregation": chosen.aggregation,
            "merge": chosen.merge if chosen.method is UeMethod.CROPTTA_DE else None,
            "views": self._frame_stage.crops.views,
            "members": self._search_matcher.members,
        }


@contextmanager
def open_run(job: GeotagJob, estimator: Estimator | None = None) -> Iterator[Run]:
    """Read the log, list the frames, open the map and load the estimator, or take the one given.

    Raises:
        UasthnError: an input cannot be used; each class has its exit code.
        ValueError: what the job asks for contradicts itself.
    """
    job = replace(job, calibration=chosen_calibration(job, is_given=estimator is not None))
    job = job if estimator else with_settled_device(job)
    has_head = None if estimator is None else says_deviations(estimator)
    chosen_uncertainty(job, has_head=has_head)
    timer = StageTimer()
    frames = list_frames(job.frames_path)
    with timer.stage("log"):
        telemetry = read_telemetry(job.log_path)
        priors = build_priors(
            telemetry, frames, config=job.prior, frame_times_csv=job.frame_times_csv
        )
        grounds = open_ground(job, telemetry, priors)
    look_up_later = partial(_rebuilt_priors, telemetry, frames, job.prior)
    with ExitStack() as maps:
        yield _opened(job, estimator, priors, grounds, look_up_later, timer, maps)


def _opened(
    job: GeotagJob,
    estimator: Estimator | None,
    logged: PriorSet,
    grounds: tuple[Ground, ...],
    look_up_later: Callable[[PriorSet, Ground | None, float], dict[str, Prior]],
    timer: StageTimer,
    maps: ExitStack,
) -> Run:
    """Open the map, load the estimator unless one is given, and build the matchers."""
    priors = grounds[0].settled_set(logged) if grounds else logged
    located = _with_position(job, priors)
    positions = np.array([(prior.lat_deg, prior.lon_deg) for prior in located])
    local = shared_frame(positions)
    native_m = native_gsd_m(job.map_path, local)
    search_gsd_m, refine_gsd_m = choose_gsds_m(job, located, native_m)
    build = MatcherBuilder(_with_shared_features(job, maps), local, timer, maps)
    search_map = build.open_map(search_gsd_m)
    search_map.require_overlap(positions, job.config.search_radius_m)
    base = estimator or open_base(job)
    uncertainty = settled_uncertainty(job, base)
    search_tiles = build.tiles(search_map, base)
    second = None if estimator else build.second_scale(search_gsd_m)
    members = build.members(search_map)
    search_matcher = build.matcher(search_map, base, search_tiles, second=second, members=members)
    is_finer = _is_finer(refine_gsd_m, search_gsd_m)
    refine_matcher = search_matcher
    if job.config.fuse:
        refine_map = build.open_map(refine_gsd_m) if is_finer else search_map
        refiner = estimator or open_refine_estimator(job, base, is_finer=is_finer)
        refine_matcher = build.matcher(refine_map, refiner, build.tiles(refine_map, refiner))
    ground = None
    if grounds:
        ground = likeliest_ground(grounds, logged, search_matcher, job.config.search_radius_m)
        priors = ground.settled_set(logged)
    flight = LoggedFlight(priors, partial(look_up_later, priors, ground), ground)
    matchers = search_matcher, refine_matcher
    crs = search_map.place.crs_wkt
    return Run(job, flight, matchers, uncertainty, crs, native_m, timer)


def _in_flight(flight: FusedFlight, refined: Mapping[str, RefinedFrame]) -> Iterator[RefinedFrame]:
    """Yield refined frames in the flight's order."""
    return (refined[frame.prior.frame.name] for frame in flight.frames)


def _is_finer(refine_gsd_m: float, search_gsd_m: float) -> bool:
    """Tell whether a refinement's grid is worth having beside the search's."""
    return refine_gsd_m < _FINER * search_gsd_m


def _with_shared_features(job: GeotagJob, opened: ExitStack) -> GeotagJob:
    """Return a job whose processes find what another has made of the map, also without a cache."""
    if job.cache_dir is not None or chosen_jobs(job) == 1:
        return job
    folder = opened.enter_context(TemporaryDirectory(prefix="uasthn-features-"))
    return replace(job, cache_dir=Path(folder))


def _with_position(job: GeotagJob, priors: PriorSet) -> list[Prior]:
    """Return the priors of frames that have one.

    Raises:
        NoPositionError: no frame has.
    """
    located = [entry for entry in priors.results if isinstance(entry, Prior)]
    if not located:
        reasons = {entry.detail for entry in priors.results if not isinstance(entry, Prior)}
        raise NoPositionError(
            f"{job.log_path}: no frame has a position ({'; '.join(sorted(reasons)[:2])}); check "
            "--time-offset, --time-base and --frame-times"
        )
    return located


def _rebuilt_priors(
    telemetry: Telemetry,
    frames: list[FrameFile],
    config: PriorConfig,
    priors: PriorSet,
    ground: Ground | None,
    added_s: float,
) -> dict[str, Prior]:
    """Return priors by frame name with ``added_s`` on the frames' times, known as they are."""
    later = replace(config, time_offset_s=config.time_offset_s + added_s)
    entries = look_up(telemetry, frames, priors.time_base.clock, priors.frame_times, later)
    found = [entry for entry in entries if isinstance(entry, Prior)]
    settled = found if ground is None else map(ground.settled, found)
    return {prior.frame.name: prior for prior in settled}
