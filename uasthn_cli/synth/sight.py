"""Where the pixels of a frame look: through the lens, onto ground that is flat or not."""

from functools import cached_property

import numpy as np

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.geometry.camera import undistort_points
from uasthn_cli.geometry.corners import transform_points
from uasthn_cli.synth.exposures import Exposure
from uasthn_cli.synth.relief import Relief
from uasthn_cli.types import CameraModel, FloatArray

_LEAST_DROP = 0.05
"""How fast a ray sinks at least, as a share of how fast the optical axis does."""

_ENOUGH_M = 1e-3
_MOST_STEPS = 60


class Sight:
    """The camera of a flight above its ground."""

    def __init__(self, camera: CameraModel, relief: Relief | None) -> None:
        """Take the lens and the ground; None is flat ground."""
        self._camera = camera
        self._relief = relief

    @property
    def is_homography(self) -> bool:
        """Whether a frame's homography alone tells where its pixels look."""
        return self._relief is None and not any(self._camera.distortion)

    def seen_m(self, exposure: Exposure, points_px: FloatArray) -> FloatArray:
        """Return where ``(n, 2)`` on the ground pixels of a frame look, in local metres.

        Raises:
            SyntheticFlightError: one looks at or near the horizon.
        """
        return self._on_ground(exposure, undistort_points(self._camera, points_px))

    def frame_seen_m(self, exposure: Exposure) -> FloatArray:
        """Return where ``(h, w, 2)`` on the ground all pixels of a frame look, in local metres.

        Raises:
            SyntheticFlightError: one looks at or near the horizon.
        """
        seen = self._on_ground(exposure, self._undistorted_px)
        return seen.reshape(self._camera.height_px, self._camera.width_px, 2)

    @cached_property
    def _undistorted_px(self) -> FloatArray:
        """All pixels of a frame as pixels ``(n, 2)`` of the undistorted one."""
        columns, rows = np.meshgrid(
            np.arange(float(self._camera.width_px)), np.arange(float(self._camera.height_px))
        )
        return undistort_points(self._camera, np.stack([columns, rows], axis=-1).reshape(-1, 2))

    def _on_ground(self, exposure: Exposure, undistorted_px: FloatArray) -> FloatArray:
        """Follow undistorted pixels ``(n, 2)`` down to the ground."""
        H = exposure.H_frame_ground
        if any(self._camera.distortion):
            centre_px = np.array([self._camera.principal_x_px, self._camera.principal_y_px])
            least = float((undistorted_px @ H[2, :2] + H[2, 2]).min())
            if least < _LEAST_DROP * float(centre_px @ H[2, :2] + H[2, 2]):
                raise SyntheticFlightError(
                    "the lens sees the horizon: take a narrower field of view or less tilt"
                )
        flat_m = transform_points(H, undistorted_px)
        if self._relief is None:
            return flat_m
        return _met(self._relief, exposure, flat_m)


def _met(relief: Relief, exposure: Exposure, flat_m: FloatArray) -> FloatArray:
    """Return where rays that would meet mean ground at ``(n, 2)`` meet the relief.

    Fixed-point steps: the ray is followed to the height of the ground below the last place. Each
    step multiplies the distance left by slope × tangent of the ray's angle from the vertical.

    Raises:
        SyntheticFlightError: the rays are too flat for the slopes.
    """
    below_m = np.array([exposure.pose.east_m, exposure.pose.north_m])
    rays = (flat_m - below_m) / exposure.pose.height_m
    seen_m: FloatArray = flat_m
    for _ in range(_MOST_STEPS):
        before_m = seen_m
        seen_m = below_m + rays * (exposure.pose.height_m - relief.at(before_m))[:, None]
        if np.abs(seen_m - before_m).max() < _ENOUGH_M:
            return seen_m
    raise SyntheticFlightError("slopes hide ground from the camera: take less relief or tilt")
