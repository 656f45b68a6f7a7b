"""The camera's attitude along a flight: what its frames say of mount, attitude and clock."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from uasthn_cli.fusion.constants import LEAST_FRAMES
from uasthn_cli.fusion.offsets import cell_offsets_m, posterior_of
from uasthn_cli.fusion.pose_smoother import (
    PoseObservations,
    SmoothedPoses,
    expected_deviations,
    smooth_poses,
)
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.rotation import tilted_attitude
from uasthn_cli.pipeline.flight_stage import FusedFlight, moved_prior
from uasthn_cli.pipeline.frame_matcher import FrameMatcher
from uasthn_cli.pipeline.ground import Ground
from uasthn_cli.pipeline.perspective import tilt_of_frame
from uasthn_cli.pipeline.pose_observations import (
    LoggedMotion,
    RebuildPriors,
    camera_to_centre_m,
    nothing_seen,
    spread_over,
)
from uasthn_cli.types import CameraModel, FloatArray, OffsetLikelihood, Prior, RefinedFrame

_PLACE_ERROR_M: Final = 2.0
"""What one frame's likelihood does not know of its own place, per axis."""

_PERSPECTIVE_FRAMES: Final = 24
_LEAST_FRAME_CELLS: Final = 60
"""A frame seen over fewer cells shows no perspective: its parts are too coarse to be placed."""


def settled_poses(
    flight: FusedFlight,
    refined: Iterable[RefinedFrame],
    matcher: FrameMatcher,
    rebuild: RebuildPriors,
    attitude_error_rad: float,
    ground: Ground | None = None,
) -> SmoothedPoses | None:
    """Return what the flight's frames say of their attitudes; None from too few.

    ``refined`` ``(T,)`` in the flight's order, read once; ``matcher`` refines, ``rebuild`` looks
    frames up at other times, ``attitude_error_rad`` is the deviation to expect of logged roll and
    pitch.
    """
    observed = _observations(flight, refined, matcher, rebuild)
    if observed is None:
        return None
    seen, chosen = observed
    if np.isfinite(seen.offsets_m).all(axis=1).sum() < LEAST_FRAMES:
        return None
    for index in spread_over(chosen, _PERSPECTIVE_FRAMES):
        tilt = tilt_of_frame(matcher, flight.corrected_priors[index], ground)
        if tilt is not None:
            seen.tilts_rad[index] = tilt.angles_rad
            seen.tilt_covariances_rad2[index] = tilt.covariance_rad2
    return smooth_poses(seen, expected_deviations(attitude_error_rad))


def tilted_prior(
    prior: Prior, camera: CameraModel, tilt_rad: FloatArray, local: LocalFrame
) -> Prior:
    """Return a prior with roll and pitch of its camera ``tilt_rad`` ``(2,)`` larger.

    Its frame's centre stays where it is, so the camera is moved.
    """
    roll_rad, pitch_rad = tilt_rad.tolist()
    tilted = replace(
        prior, attitude=tilted_attitude(prior.attitude, camera.mount, roll_rad, pitch_rad)
    )
    return moved_prior(
        tilted, camera_to_centre_m(prior, camera) - camera_to_centre_m(tilted, camera), local
    )


def _observations(
    flight: FusedFlight,
    refined: Iterable[RefinedFrame],
    matcher: FrameMatcher,
    rebuild: RebuildPriors,
) -> tuple[PoseObservations, list[int]] | None:
    """Return what frames' places say, and which frames are large enough to show perspective.

    None where no frame can be read.
    """
    motion = LoggedMotion(rebuild, flight.constants.clock_to_apply_s, matcher.local)
    seen, chosen = None, []
    for index, entry in enumerate(refined):
        camera, prior, posed = (
            entry.camera,
            flight.frames[index].prior,
            flight.corrected_priors[index],
        )
        if camera is None:
            continue
        if seen is None:
            seen = nothing_seen(flight.corrected_priors, camera)
        per_second_m = motion.per_second_m(prior, camera)
        if entry.likelihood is None or per_second_m is None:
            continue
        place_m, seen.covariances_m2[index] = _own_place(entry.likelihood)
        seen.per_second_m[index] = per_second_m
        seen.offsets_m[index] = place_m + motion.beside_log_m(prior)
        if _frame_cells(camera, posed, matcher) >= _LEAST_FRAME_CELLS:
            chosen.append(index)
    return None if seen is None else (seen, chosen)


def _own_place(likelihood: OffsetLikelihood) -> tuple[FloatArray, FloatArray]:
    """Return mean ``(2,)`` and covariance ``(2, 2)`` of what a frame alone says of its offset."""
    posterior = posterior_of(likelihood)
    east_m, north_m = cell_offsets_m(len(posterior), likelihood.cell_m, likelihood.centre_m)
    mean_m = np.array([(posterior * east_m).sum(), (posterior * north_m).sum()])
    east_m, north_m = east_m - mean_m[0], north_m - mean_m[1]
    across = float((posterior * east_m * north_m).sum())
    spread_m2 = [
        [(posterior * east_m**2).sum(), across],
        [across, (posterior * north_m**2).sum()],
    ]
    return mean_m, np.array(spread_m2) + np.eye(2) * _PLACE_ERROR_M**2


def _frame_cells(camera: CameraModel, prior: Prior, matcher: FrameMatcher) -> float:
    """Return over how many cells of the map a frame's width is seen."""
    width_m = prior.height_above_ground_m * camera.width_px / camera.focal_x_px
    return width_m / matcher.pitch_m
