"""The whole flight: fuse what frames gave alone, learn its constants, refine, place anew."""

import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.config import DEFAULT_ATTITUDE_ERROR_DEG, TOLERANCE_M, CropTtaConfig
from uasthn_cli.fusion.constants import (
    LEAST_FRAMES,
    Constant,
    FlightConstants,
    constants_of_views,
)
from uasthn_cli.fusion.diffusion import fit_diffusion
from uasthn_cli.fusion.forward_backward import smooth
from uasthn_cli.fusion.offsets import OffsetGrid, best_offset_m
from uasthn_cli.fusion.pose_smoother import expected_deviations, smooth_poses
from uasthn_cli.fusion.spool import LikelihoodSpool
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.pipeline.frame_matcher import FrameMatcher, Scene, UnmatchableFrameError
from uasthn_cli.pipeline.ground import Ground
from uasthn_cli.pipeline.likelihoods import likelihood_of_match
from uasthn_cli.pipeline.pose_observations import (
    LoggedMotion,
    RebuildPriors,
    nothing_seen,
    position_m,
    spread_over,
)
from uasthn_cli.seam import Aligner
from uasthn_cli.types import (
    Attitude,
    BoolArray,
    CameraModel,
    Fix,
    FloatArray,
    FrameFailure,
    FrameResult,
    Located,
    Prior,
    Reason,
    RefinedFrame,
)

_log = logging.getLogger(__name__)

PLACEABLE = (Reason.TEXTURELESS, Reason.OFF_MAP, Reason.DEGENERATE_HOMOGRAPHY)
"""Reasons for which a frame has no answer of its own, yet its camera is known."""

_CONSTANTS_FRAMES = 12
_CONFIDENT = 0.5
_REFINE_REACH_M = 15.0
_REFINE_REACH_PITCHES = 5
_REFINE_REACH_CELLS = 1.25  # of the search's grid: a wide search is known to one of its cells
_REFINE_CELLS_PER_PITCH = 4
_REFINE_LARGEST_HALF = 150
_REFINE_MARGIN_PITCHES = 3
_WHOLE_FRAME = CropTtaConfig(views=1)


@dataclass(frozen=True, slots=True)
class FlightFrame:
    """One frame of the fused flight: its prior in the log, and what came of it alone."""

    prior: Prior
    result: FrameResult

    @property
    def single(self) -> Fix | None:
        """The frame's own answer, if it has one."""
        return self.result if isinstance(self.result, Fix) else None


@dataclass(frozen=True, slots=True)
class FusedFlight:
    """A flight after the first fusion.

    ``frames`` in order of time, ``offsets_m`` ``(T, 2)`` (east, north) the error of each logged
    position, ``posteriors`` those over the whole search area, each ``(n, n)``,
    ``corrected_priors`` what is known of each frame now.
    """

    frames: tuple[FlightFrame, ...]
    times_s: FloatArray
    offsets_m: FloatArray
    posteriors: Sequence[NDArray[np.float32]]
    grid: OffsetGrid
    diffusion_m_per_sqrt_s: float
    constants: FlightConstants
    corrected_priors: tuple[Prior, ...]


class FlightStage:
    """Fuses a flight and refines its frames near where it settled."""

    def __init__(
        self,
        search_matcher: FrameMatcher,
        refine_matcher: FrameMatcher,
        grid: OffsetGrid,
        rebuild_priors: RebuildPriors,
        ground: Ground | None = None,
        attitude_error_rad: float = math.radians(DEFAULT_ATTITUDE_ERROR_DEG),
    ) -> None:
        """Keep how the flight was searched and is refined; ``ground`` None: it is flat."""
        self._ground, self._attitude_error_rad = ground, attitude_error_rad
        self._search_matcher, self._refine_matcher = search_matcher, refine_matcher
        self._grid, self._local = grid, search_matcher.local
        self._rebuild_priors = rebuild_priors
        pitches_m = _REFINE_REACH_PITCHES * refine_matcher.pitch_m
        self._reach_m = max(_REFINE_REACH_M, pitches_m, _REFINE_REACH_CELLS * grid.cell_m)

    @property
    def refine_grid(self) -> OffsetGrid:
        """The offsets that the refinement tells apart."""
        finest_m = self._reach_m / _REFINE_LARGEST_HALF
        cell_m = max(self._refine_matcher.pitch_m / _REFINE_CELLS_PER_PITCH, finest_m)
        return OffsetGrid(round(self._reach_m / cell_m), cell_m)

    def fuse(self, located: Iterable[Located]) -> FusedFlight | None:
        """Fuse what frames gave alone; None where no frame says anything.

        ``located`` is read once, an entry at a time, and likelihoods go to disk.
        """
        frames, likelihoods = flight_frames(located)
        if not likelihoods.says_anything:
            return None
        times_s = np.array([frame.prior.time_utc_s for frame in frames])
        velocities_m_s = self._velocities_m_s(frames)
        speed_m_s = float(np.median(np.linalg.norm(velocities_m_s, axis=1)))
        diffusion = fit_diffusion(likelihoods, times_s, speed_m_s, self._grid.radius_m or 0.0)
        smoothed = smooth(likelihoods, times_s, diffusion)
        cell_m = self._grid.cell_m
        offsets_m = np.array(
            [best_offset_m(entry, cell_m, np.zeros(2)) for entry in smoothed.posteriors]
        )
        constants = self._constants(frames, offsets_m)
        return FusedFlight(
            frames=frames,
            times_s=times_s,
            offsets_m=offsets_m,
            posteriors=smoothed.posteriors,
            grid=self._grid,
            diffusion_m_per_sqrt_s=diffusion,
            constants=constants,
            corrected_priors=self._corrected_priors(frames, offsets_m, constants),
        )

    def refine(self, flight: FusedFlight, index: int) -> RefinedFrame:
        """Return how well frame ``index`` fits around where the flight has it."""
        prior, centre_m = flight.corrected_priors[index], flight.offsets_m[index]
        # scores are interpolated: none that is excluded may lie beside the grid's corners
        margin_m = _REFINE_MARGIN_PITCHES * self._refine_matcher.pitch_m
        radius_m = math.sqrt(2.0) * self._reach_m + margin_m
        try:
            match = self._refine_matcher.match(prior, _WHOLE_FRAME, radius_m, self._ground)
        except UnmatchableFrameError as error:
            _log.debug("%s: %s", prior.frame.name, error)
            return RefinedFrame(prior.frame, self._camera(prior), None)
        likelihood = likelihood_of_match(match, self.refine_grid, centre_m)
        return RefinedFrame(prior.frame, match.scene.camera, likelihood)

    def _camera(self, prior: Prior) -> CameraModel | None:
        try:
            return self._refine_matcher.camera_of(prior)
        except UnmatchableFrameError:
            return None

    def _velocities_m_s(self, frames: Sequence[FlightFrame]) -> FloatArray:
        """Return ground velocities ``(T, 2)`` in the log, over the next second or the last."""
        later = self._rebuild_priors(1.0)
        is_whole = all(frame.prior.frame.name in later for frame in frames)
        earlier = {} if is_whole else self._rebuild_priors(-1.0)
        velocities = []
        for frame in frames:
            name = frame.prior.frame.name
            end = later.get(name, frame.prior)
            start = frame.prior if name in later else earlier.get(name, frame.prior)
            velocities.append(position_m(end, self._local) - position_m(start, self._local))
        return np.array(velocities)

    def _constants(self, frames: Sequence[FlightFrame], offsets_m: FloatArray) -> FlightConstants:
        """Estimate what stays wrong from frames that alone say what the flight says."""
        sure = agreeing(frames, offsets_m, self._local)
        sure &= np.array(
            [f.single is not None and f.single.trust.confidence > _CONFIDENT for f in frames]
        )
        known = np.flatnonzero(sure).tolist()
        chosen = spread_over(known, _CONSTANTS_FRAMES)
        views = self._views([(frames[index].prior, offsets_m[index]) for index in chosen])
        yaw_rad, log_scale = views or (None, None)
        return FlightConstants(yaw_rad, log_scale, self._clock(frames, known))

    def _clock(self, frames: Sequence[FlightFrame], sure: Sequence[int]) -> Constant | None:
        """Return by how much frames are stamped too early, told apart from mount and drift.

        None from too few ``sure`` frames.
        """
        if len(sure) < LEAST_FRAMES:
            return None
        camera = self._camera(frames[sure[0]].prior)
        if camera is None:
            return None
        motion = LoggedMotion(self._rebuild_priors, 0.0, self._local)
        seen = nothing_seen([frame.prior for frame in frames], camera)
        for index in sure:
            prior, single = frames[index].prior, frames[index].single
            per_second_m = motion.per_second_m(prior, camera)
            if single is None or per_second_m is None:
                continue
            own_m = self._local.to_metres(np.array([single.lat_deg, single.lon_deg]))
            seen.offsets_m[index] = own_m - position_m(prior, self._local)
            seen.covariances_m2[index] = single.trust.covariance_m2
            seen.per_second_m[index] = per_second_m
        return smooth_poses(seen, expected_deviations(self._attitude_error_rad)).clock_s

    def _views(
        self, places: Sequence[tuple[Prior, FloatArray]]
    ) -> tuple[Constant, Constant] | None:
        """Estimate turn and scale from frames, each with its offset; None from too few."""
        estimator = self._refine_matcher.estimator
        if not isinstance(estimator, Aligner):
            return None
        scenes = filter(None, map(self._scene, places))
        frames = [estimator.fit_scores(s.features, s.thermal, s.origin_px) for s in scenes]
        if len(frames) < LEAST_FRAMES:
            return None
        return constants_of_views(
            lambda hypotheses: np.stack([scores_of(hypotheses) for scores_of in frames])
        )

    def _scene(self, place: tuple[Prior, FloatArray]) -> Scene | None:
        """Return a frame near where its offset puts it; None where nothing can be seen."""
        prior, offset_m = place
        try:
            moved = self._settled(moved_prior(prior, offset_m, self._local))
            return self._refine_matcher.scene(moved, self._reach_m, self._ground)
        except UnmatchableFrameError as error:
            _log.debug("%s: %s", prior.frame.name, error)
            return None

    def _corrected_priors(
        self, frames: Sequence[FlightFrame], offsets_m: FloatArray, constants: FlightConstants
    ) -> tuple[Prior, ...]:
        """Return each prior moved to where the flight has it, and freed of the flight's constants.

        A corrected clock changes attitude and height; its part in the position is in the offset.
        """
        retimed: dict[str, Prior] = {}
        if constants.clock_to_apply_s:
            retimed = self._rebuild_priors(constants.clock_to_apply_s)
        corrected = []
        for frame, offset_m in zip(frames, offsets_m, strict=True):
            moved = moved_prior(frame.prior, offset_m, self._local)
            logged = retimed.get(frame.prior.frame.name, frame.prior)
            there = replace(logged, lat_deg=moved.lat_deg, lon_deg=moved.lon_deg)
            posed = self._settled(there)
            attitude = posed.attitude
            turned = Attitude(
                attitude.roll_rad,
                attitude.pitch_rad,
                attitude.yaw_rad + constants.yaw_to_apply_rad,
            )
            height_m = posed.height_above_ground_m * constants.scale_to_apply
            # the altitude stays as logged: what the scale corrects may be the lens or the ground
            corrected.append(
                replace(
                    moved,
                    attitude=turned,
                    height_above_ground_m=height_m,
                    alt_amsl_m=posed.alt_amsl_m,
                    ground_m=posed.ground_m,
                )
            )
        return tuple(corrected)

    def _settled(self, prior: Prior) -> Prior:
        """Return a prior that was moved with its height above the ground where it is now."""
        return prior if self._ground is None else self._ground.settled(prior)


def flight_frames(located: Iterable[Located]) -> tuple[tuple[FlightFrame, ...], LikelihoodSpool]:
    """Return the frames that the flight can place and their likelihoods, in order of time."""
    frames, likelihoods = [], LikelihoodSpool()
    for entry in located:
        result = entry.result
        is_lost = isinstance(result, FrameFailure) and result.reason not in PLACEABLE
        if result.prior is not None and not is_lost:
            frames.append(FlightFrame(result.prior, result))
            likelihoods.append(entry.likelihood)
    order = sorted(range(len(frames)), key=lambda index: frames[index].prior.time_utc_s)
    return tuple(frames[index] for index in order), likelihoods.in_order(order)


def agreeing(frames: Sequence[FlightFrame], offsets_m: FloatArray, local: LocalFrame) -> BoolArray:
    """Tell which frames ``(T,)`` alone say what the flight says, to within the tolerance."""
    return agreement_m(frames, offsets_m, local) <= TOLERANCE_M


def agreement_m(
    frames: Sequence[FlightFrame], offsets_m: FloatArray, local: LocalFrame
) -> FloatArray:
    """Return the distances ``(T,)`` of own and fused camera positions; NaN without an own one."""
    distances = np.full(len(frames), np.nan)
    for index, frame in enumerate(frames):
        if frame.single is not None:
            own_m = local.to_metres(np.array([frame.single.lat_deg, frame.single.lon_deg]))
            fused_m = position_m(frame.prior, local) + offsets_m[index]
            distances[index] = np.linalg.norm(own_m - fused_m)
    return distances


def moved_prior(prior: Prior, offset_m: FloatArray, local: LocalFrame) -> Prior:
    """Return a prior ``offset_m`` (east, north) farther."""
    lat_deg, lon_deg = local.to_degrees(position_m(prior, local) + offset_m)
    return replace(prior, lat_deg=float(lat_deg), lon_deg=float(lon_deg))
