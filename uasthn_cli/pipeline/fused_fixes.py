"""From a fused flight to one answer per frame."""

import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.fusion.forward_backward import smooth
from uasthn_cli.fusion.offsets import (
    OffsetGrid,
    best_offset_m,
    flat_likelihood,
    summarise_posterior,
)
from uasthn_cli.fusion.pose_smoother import SmoothedPoses
from uasthn_cli.fusion.spool import LikelihoodSpool
from uasthn_cli.geometry.camera import HorizonError, homography_frame_ground, undistort_points
from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m
from uasthn_cli.geometry.placement import Placement, place_frame, translation
from uasthn_cli.geometry.surface import CameraOverSurface
from uasthn_cli.pipeline.flight_poses import tilted_prior
from uasthn_cli.pipeline.flight_stage import (
    FlightFrame,
    FusedFlight,
    agreement_m,
    moved_prior,
)
from uasthn_cli.pipeline.ground import Ground
from uasthn_cli.pipeline.neighbours import neighbours_in_words
from uasthn_cli.pipeline.trust_model import Agreement, CameraTrust, TrustModel
from uasthn_cli.types import (
    CameraModel,
    Fix,
    FloatArray,
    FrameResult,
    Located,
    MapGrid,
    OffsetLikelihood,
    Prior,
    Reason,
    RefinedFrame,
    Source,
    Trust,
)
from uasthn_cli.uncertainty.decide import Rejection

_log = logging.getLogger(__name__)

_NEIGHBOURS = 12
"""Each way. Over a wrong map a few frames in a row agree by chance; of 25, hardly ever most."""
_METRE_GRID = MapGrid(gsd_m=1.0)
"""A grid of metres: places are computed straight from geometry."""


def fused_offsets_m(
    flight: FusedFlight, refined: Sequence[OffsetLikelihood | None], grid: OffsetGrid
) -> tuple[FloatArray, FloatArray]:
    """Return offsets ``(T, 2)`` and covariances ``(T, 2, 2)`` from the refinement of all frames.

    Where no refined frame says anything, the first fusion stands.
    """
    if not any(entry is not None for entry in refined):
        summaries = [
            summarise_posterior(entry, flight.grid.cell_m, np.zeros(2), offset_m)
            for entry, offset_m in zip(flight.posteriors, flight.offsets_m, strict=True)
        ]
        return flight.offsets_m, np.array([entry.covariance_m2 for entry in summaries])
    centred = LikelihoodSpool(
        entry or flat_likelihood(grid, offset_m)
        for entry, offset_m in zip(refined, flight.offsets_m, strict=True)
    )
    smoothed = smooth(centred, flight.times_s, flight.diffusion_m_per_sqrt_s)
    offsets_m, covariances_m2 = [], []
    for posterior, centre_m in zip(smoothed.posteriors, flight.offsets_m, strict=True):
        offset_m = best_offset_m(posterior, grid.cell_m, centre_m)
        summary = summarise_posterior(posterior, grid.cell_m, centre_m, offset_m)
        offsets_m.append(offset_m)
        covariances_m2.append(summary.covariance_m2)
    return np.array(offsets_m), np.array(covariances_m2)


def fused_results(
    located: Iterable[Located],
    flight: FusedFlight,
    refined: Iterable[RefinedFrame],
    grid: OffsetGrid,
    trust_model: TrustModel,
    local: LocalFrame,
    ground: Ground | None = None,
    poses: SmoothedPoses | None = None,
) -> list[FrameResult]:
    """Return the flight's answer for every frame it can place; other frames keep their own.

    ``refined`` ``(T,)`` are the flight's frames near their places, on offsets of ``grid``. Both are
    read once, an entry at a time. ``ground`` None: it is flat. ``poses`` None: attitudes are
    as logged.
    """
    cameras, likelihoods = _taken_apart(refined)
    offsets_m, covariances_m2 = fused_offsets_m(flight, likelihoods, grid)
    apart_m = agreement_m(flight.frames, offsets_m, local)
    support = support_of(_backing(flight.frames, apart_m))
    near = near_frames(len(flight.frames))
    answers: dict[str, Fix] = {}
    for index, (frame, camera) in enumerate(zip(flight.frames, cameras, strict=True)):
        moved_m = offsets_m[index] - flight.offsets_m[index]
        posed = moved_prior(flight.corrected_priors[index], moved_m, local)
        if poses is not None and camera is not None:
            posed = tilted_prior(posed, camera, poses.tilt_rad[index], local)
        placed = None if camera is None else _placed(camera, posed, local, ground)
        if placed is None:
            continue
        summary = summarise_posterior(
            flight.posteriors[index], flight.grid.cell_m, np.zeros(2), offsets_m[index]
        )
        agreement = Agreement(float(apart_m[index]), float(support[index]))
        uncertainty_m = frame.single.uncertainty_m if frame.single else math.nan
        trust = trust_model.fused(summary, covariances_m2[index], agreement, uncertainty_m)
        rejection = _own_rejection(frame)
        if rejection is None and (judged := trust_model.rejection_of_fused(trust)):
            said = neighbours_in_words(flight.frames, apart_m, near[index], index)
            rejection = Rejection(judged.reason, f"{judged.detail}: {said}")
        tilt_covariance = None if poses is None else poses.tilt_covariances_rad2[index]
        camera_trust = trust_model.camera(
            trust, placed.attitude, posed.height_above_ground_m, tilt_covariance
        )
        answers[frame.prior.frame.name] = _fix(
            frame, posed, placed, trust, camera_trust, rejection, local
        )
    return [answers.get(_name(entry.result), entry.result) for entry in located]


def _taken_apart(
    refined: Iterable[RefinedFrame],
) -> tuple[list[CameraModel | None], LikelihoodSpool]:
    """Return cameras and likelihoods of refined frames, which are read once."""
    cameras, likelihoods = [], LikelihoodSpool()
    for frame in refined:
        cameras.append(frame.camera)
        likelihoods.append(frame.likelihood)
    return cameras, likelihoods


def _backing(frames: Sequence[FlightFrame], apart_m: FloatArray) -> FloatArray:
    """Return how sure ``(T,)`` each frame is, alone, of what the flight says; 0 if it disagrees.

    Over a wrong map neighbours see the same wrong thing and may well agree, but none of them is
    sure: counted by confidence, no such flight came near one over the right map.
    """
    own = np.array(
        [0.0 if frame.single is None else frame.single.trust.confidence for frame in frames]
    )
    return np.where(apart_m <= TOLERANCE_M, own, 0.0)


def support_of(backing: FloatArray) -> FloatArray:
    """Return for each frame the mean ``(T,)`` of the 25 nearest frames, in the log's order.

    ``backing`` ``(T,)`` in 0..1; a frame counts among its own neighbours. Near the ends of a flight
    more of them lie on one side: fewer would agree by chance more often.
    """
    sums = np.concatenate([[0.0], np.cumsum(backing)])
    ends = np.array([(near.start, near.stop) for near in near_frames(len(backing))]).reshape(-1, 2)
    return np.asarray((sums[ends[:, 1]] - sums[ends[:, 0]]) / (ends[:, 1] - ends[:, 0]))


def near_frames(total: int) -> list[range]:
    """Return for each of so many frames the 25 nearest, itself among them."""
    width = 2 * _NEIGHBOURS + 1
    first = np.clip(np.arange(total) - _NEIGHBOURS, 0, max(total - width, 0)).tolist()
    return [range(start, min(start + width, total)) for start in first]


def _placed(
    camera: CameraModel, prior: Prior, local: LocalFrame, ground: Ground | None
) -> Placement | None:
    """Return where a frame lies; None where a corrected clock has it look above the horizon."""
    try:
        over = None if ground is None else ground.over(camera, prior)
        if over is not None:
            return place_over_surface(over, prior, local)
        return place_from_geometry(camera, prior, local)
    except HorizonError as error:
        _log.debug("%s: %s", prior.frame.name, error)
        return None


def place_from_geometry(camera: CameraModel, prior: Prior, local: LocalFrame) -> Placement:
    """Return where a frame lies if its prior is right, on flat ground.

    Raises:
        HorizonError: a corner of the frame does not look at the ground.
    """
    position_m = local.to_metres(np.array([prior.lat_deg, prior.lon_deg]))
    H_frame_ground = homography_frame_ground(camera, prior.attitude, prior.height_above_ground_m)
    nadir_px = position_m * (1.0, -1.0)
    flipped = np.diag([1.0, -1.0, 1.0])
    H_frame_grid = translation(nadir_px) @ flipped @ H_frame_ground
    return place_frame(camera, prior.attitude, H_frame_grid, nadir_px, _METRE_GRID)


def place_over_surface(over: CameraOverSurface, prior: Prior, local: LocalFrame) -> Placement:
    """Return where a frame lies over relief: where the rays of its centre and corners end.

    Raises:
        HorizonError: a corner of the frame does not look at the ground.
    """
    camera = over.camera
    width_px, height_px = camera.width_px, camera.height_px
    center_px = np.array([[(width_px - 1) / 2, (height_px - 1) / 2]])
    seen_px = np.vstack([center_px, image_corners_px(width_px, height_px)])
    places_m = over.to_ground(undistort_points(camera, seen_px))
    # flat ground as far below as the centre's gives heading and ground size of the centre pixel
    height_m = over.altitude_m - float(over.ground_m(places_m[0]))
    flat = place_from_geometry(camera, replace(prior, height_above_ground_m=height_m), local)
    return replace(flat, center_m=places_m[0], corners_m=places_m[1:])


def _own_rejection(frame: FlightFrame) -> Rejection | None:
    """Return why a fused answer cannot be accepted whatever the flight says."""
    own = frame.result
    if own.reason in {Reason.OFF_MAP, Reason.TEXTURELESS}:
        return Rejection(own.reason, own.detail)
    return None


def _fix(
    frame: FlightFrame,
    posed: Prior,
    placed: Placement,
    trust: Trust,
    camera_trust: CameraTrust,
    rejection: Rejection | None,
    local: LocalFrame,
) -> Fix:
    degrees = placed.in_degrees(local)
    roll_deg, pitch_deg, yaw_deg = placed.angles_deg
    prior, single = frame.prior, frame.single
    prior_deg = np.array([prior.lat_deg, prior.lon_deg])
    unknown = np.full((4, 2), np.nan)
    return Fix(
        prior=prior,
        lat_deg=float(degrees[0, 0]),
        lon_deg=float(degrees[0, 1]),
        center_lat_deg=float(degrees[1, 0]),
        center_lon_deg=float(degrees[1, 1]),
        corners_deg=degrees[2:],
        corner_std_m=single.corner_std_m if single else unknown,
        uncertainty_m=single.uncertainty_m if single else math.nan,
        offset_m=float(distance_m(degrees[0], prior_deg)),
        roll_deg=roll_deg,
        pitch_deg=pitch_deg,
        yaw_deg=yaw_deg,
        height_above_ground_m=posed.height_above_ground_m,
        alt_amsl_m=posed.alt_amsl_m,
        gsd_m=placed.gsd_m,
        trust=trust,
        camera_covariance_m2=camera_trust.covariance_m2,
        camera_ce90_m=camera_trust.ce90_m,
        accepted=rejection is None,
        reason=rejection.reason if rejection else None,
        detail=rejection.detail if rejection else "",
        source=Source.FUSED,
        single=single,
    )


def _name(result: FrameResult) -> str:
    return result.prior.frame.name if isinstance(result, Fix) else result.frame.name
