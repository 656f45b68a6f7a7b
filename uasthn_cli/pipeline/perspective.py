"""How a frame is tilted beyond what its prior says, by where its parts are found on the map."""

import logging
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from uasthn_cli.geometry.camera import homography_frame_ground
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.rotation import tilted_attitude
from uasthn_cli.pipeline.frame_matcher import FrameMatcher, UnmatchableFrameError
from uasthn_cli.pipeline.ground import Ground
from uasthn_cli.types import CameraModel, FloatArray, Prior

_log = logging.getLogger(__name__)

_BLOCKS: Final = 3
"""Parts of a frame along each side."""

_REACH_M: Final = 15.0
_STEP_RAD: Final = 0.01
_ROUNDS: Final = 10
_OUTLIER: Final = 1.5
_LEAST_RESIDUAL_M: Final = 0.3
_UNSEEN_SCATTER: Final = 1.5
"""Tilts of frames of rendered flights scatter by so much more than the fit says."""


@dataclass(frozen=True, slots=True)
class Tilt:
    """Roll and pitch ``(2,)`` beyond the prior's, and their covariance ``(2, 2)``."""

    angles_rad: FloatArray
    covariance_rad2: FloatArray


def tilt_of_frame(matcher: FrameMatcher, prior: Prior, ground: Ground | None = None) -> Tilt | None:
    """Return how a frame is tilted beyond ``prior``, whose place is right to some metres.

    Its parts are matched on their own; a tilt moves those at the edges against the middle. Shift,
    scale and turn are left free. None where the frame cannot be matched.
    """
    try:
        scene = matcher.scene(prior, _REACH_M, ground)
    except UnmatchableFrameError as error:
        _log.debug("%s: %s", prior.frame.name, error)
        return None
    camera, gsd_m = scene.camera, scene.thermal.gsd_m
    whole_px = image_corners_px(camera.width_px, camera.height_px)[None]
    parts_px = _parts_px(camera.width_px, camera.height_px)
    views_px = transform_points(scene.thermal.H_frame_ortho, np.concatenate([whole_px, parts_px]))
    found = matcher.estimator.estimate(scene.features, scene.thermal, views_px, scene.origin_px)
    moved_px = (found.corners_px - views_px - scene.origin_px)[1:].mean(axis=1)
    design = _design(camera, prior, parts_px.mean(axis=1))
    return _fitted(design, (moved_px * (gsd_m, -gsd_m)).ravel())


def _parts_px(width_px: int, height_px: int) -> FloatArray:
    """Return the corners ``(9, 4, 2)`` of a frame's parts."""
    x, y = (np.linspace(0, size, _BLOCKS + 1) - 0.5 for size in (width_px, height_px))
    return np.array(
        [
            [(x[i], y[j]), (x[i + 1], y[j]), (x[i], y[j + 1]), (x[i + 1], y[j + 1])]
            for j in range(_BLOCKS)
            for i in range(_BLOCKS)
        ]
    )


def _design(camera: CameraModel, prior: Prior, parts_px: FloatArray) -> FloatArray:
    """Return ``(18, 6)``: metres (east, north) by which each unknown moves each part's middle.

    Roll, pitch (radians, the frame's centre staying in place), growth, turn, shift.
    """
    middle_px = np.array([[(camera.width_px - 1) / 2, (camera.height_px - 1) / 2]])
    points_px = np.concatenate([middle_px, parts_px])

    def from_centre_m(roll_rad: float, pitch_rad: float) -> FloatArray:
        attitude = tilted_attitude(prior.attitude, camera.mount, roll_rad, pitch_rad)
        H_frame_ground = homography_frame_ground(camera, attitude, prior.height_above_ground_m)
        ground_m = transform_points(H_frame_ground, points_px)
        return np.asarray(ground_m[1:] - ground_m[0])

    seen_m = from_centre_m(0.0, 0.0)
    ones, zeros = np.ones(len(seen_m)), np.zeros(len(seen_m))
    columns = (
        (from_centre_m(_STEP_RAD, 0.0) - seen_m) / _STEP_RAD,
        (from_centre_m(0.0, _STEP_RAD) - seen_m) / _STEP_RAD,
        seen_m,
        np.stack([seen_m[:, 1], -seen_m[:, 0]], axis=1),
        np.stack([ones, zeros], axis=1),
        np.stack([zeros, ones], axis=1),
    )
    return np.stack([column.ravel() for column in columns], axis=1)


def _fitted(design: FloatArray, moved_m: FloatArray) -> Tilt:
    """Return the tilt that explains ``moved_m`` ``(18,)`` best; parts far off count little."""
    weights, scale_m = np.ones(len(moved_m)), math.inf
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)
        values = np.linalg.lstsq(design * root[:, None], moved_m * root, rcond=None)[0]
        residual_m = np.hypot(*(moved_m - design @ values).reshape(-1, 2).T)
        scale_m = max(float(np.median(residual_m)), _LEAST_RESIDUAL_M)
        weights = np.repeat(1.0 / (1.0 + (residual_m / (_OUTLIER * scale_m)) ** 2), 2)
    covariance = np.linalg.inv(design.T @ (design * weights[:, None])) * scale_m**2
    tilt_rad2 = covariance[:2, :2] * _UNSEEN_SCATTER**2
    return Tilt(np.asarray(values[:2], np.float64), np.asarray(tilt_rad2, np.float64))
