"""What moves frames' centres: tilts and time, and how far frames were found beside the log."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from uasthn_cli.fusion.pose_smoother import PoseObservations
from uasthn_cli.geometry.camera_error import camera_per_tilt_m, centre_from_camera_m
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.rotation import turned_attitude
from uasthn_cli.types import CameraModel, FloatArray, Prior

RebuildPriors = Callable[[float], dict[str, Prior]]
"""Priors by frame name when this many seconds are added to the frames' times."""

_HALF_STEP_S: Final = 0.25


def position_m(prior: Prior, local: LocalFrame) -> FloatArray:
    """Return a prior's position ``(2,)`` (east, north)."""
    return local.to_metres(np.array([prior.lat_deg, prior.lon_deg]))


def camera_to_centre_m(prior: Prior, camera: CameraModel) -> FloatArray:
    """Return metres ``(2,)`` from below a camera to its frame's centre, on flat ground."""
    attitude = turned_attitude(prior.attitude, camera.mount)
    return centre_from_camera_m(attitude, prior.height_above_ground_m)


def nothing_seen(priors: Sequence[Prior], camera: CameraModel) -> PoseObservations:
    """Return the observations of frames, in order of time, that were found nowhere yet.

    ``priors`` say how the camera was turned: what a tilt does is known.
    """
    count = len(priors)
    unknown, nothing = np.full((count, 2), np.nan), np.zeros((count, 2, 2))
    # what moves the camera with its centre in place moves the centre the other way
    per_tilt_m = [
        -camera_per_tilt_m(
            turned_attitude(prior.attitude, camera.mount), prior.height_above_ground_m
        )
        for prior in priors
    ]
    return PoseObservations(
        times_s=np.array([prior.time_utc_s for prior in priors]),
        offsets_m=unknown,
        covariances_m2=nothing,
        per_tilt_m=np.array(per_tilt_m),
        per_second_m=np.zeros((count, 2)),
        tilts_rad=unknown.copy(),
        tilt_covariances_rad2=nothing.copy(),
    )


def spread_over(indices: Sequence[int], count: int) -> list[int]:
    """Return at most ``count`` of some frames' indices, evenly spread."""
    if len(indices) <= count:
        return list(indices)
    places = np.linspace(0, len(indices) - 1, count).round().astype(int)
    return [indices[place] for place in places.tolist()]


class LoggedMotion:
    """How frames' centres move with time, in a log whose frames are ``clock_s`` late."""

    def __init__(self, rebuild: RebuildPriors, clock_s: float, local: LocalFrame) -> None:
        """Look frames up a little earlier and later."""
        self._local = local
        self._logged = rebuild(clock_s) if clock_s else {}
        self._earlier, self._later = (
            rebuild(clock_s + step_s) for step_s in (-_HALF_STEP_S, _HALF_STEP_S)
        )

    def per_second_m(self, prior: Prior, camera: CameraModel) -> FloatArray | None:
        """Return metres ``(2,)`` by which a frame's centre moves in a second; None: unknown."""
        name = prior.frame.name
        before, after = self._earlier.get(name), self._later.get(name)
        if before is None or after is None:
            return None
        step_m = position_m(after, self._local) - position_m(before, self._local)
        turned_m = camera_to_centre_m(after, camera) - camera_to_centre_m(before, camera)
        return np.asarray((step_m + turned_m) / (2 * _HALF_STEP_S))

    def beside_log_m(self, prior: Prior) -> FloatArray:
        """Return metres ``(2,)`` from where a frame is logged at its right time to ``prior``."""
        logged = self._logged.get(prior.frame.name, prior)
        return position_m(prior, self._local) - position_m(logged, self._local)
