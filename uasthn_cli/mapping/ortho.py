"""Rectify a frame to flat ground: north-up, at the GSD of the map."""

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.config import MAX_TILT_DEG
from uasthn_cli.geometry.camera import (
    HorizonError,
    camera_matrix,
    distortion_coefficients,
    homography_frame_ground,
    tilt_rad,
)
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.pixels import resize_homography
from uasthn_cli.types import BoolArray, CameraModel, FloatArray, ImageArray, Ortho, Prior

_MIN_ORTHO_PX = 8
_MAX_ORTHO_PX = 4096
_MIN_DEVIATION = 1e-6
_BLUR_PER_RATIO = 0.45
_BOX_DEVIATION = 1 / math.sqrt(12)
_BORDER_MARGIN_PX = 1 / 16
"""``warpPerspective`` rounds source positions to 1/32 pixel."""


class ObliqueFrameError(ValueError):
    """The frame is tilted too far, or sees the horizon."""


class TexturelessFrameError(ValueError):
    """The frame has the same value everywhere."""


class FootprintSizeError(ValueError):
    """The frame's footprint has no sensible size at this height and GSD."""


def rectify(
    image: ImageArray, camera: CameraModel, prior: Prior, gsd_m: float, *, multiple_px: int = 1
) -> Ortho:
    """Return a frame ``(h, w)`` as the north-up picture of the ground that the prior implies.

    The ortho is just large enough for the footprint, its sides rounded up to ``multiple_px``.
    ``H_frame_ortho`` takes pixels of the undistorted frame (same camera matrix).

    Raises:
        ObliqueFrameError: tilted beyond ``MAX_TILT_DEG``, or a corner sees the horizon.
        TexturelessFrameError: the frame is constant.
        FootprintSizeError: the height gives no footprint, or an absurdly small or large one.
        ValueError: the frame does not have the camera's size.
    """
    if image.shape != (camera.height_px, camera.width_px):
        raise ValueError(
            f"the frame is {image.shape[1]} × {image.shape[0]} pixels,"
            f" the camera {camera.width_px} × {camera.height_px}"
        )
    if not _has_texture(image):
        raise TexturelessFrameError("the frame has the same value everywhere")
    H_frame_ortho, nadir_px, size_px = _plan(camera, prior, gsd_m, multiple_px)
    seen = None
    if any(camera.distortion):
        image, seen = _undistort(image, camera)
    small, H_frame_small = _reduce(image, _frame_pixels_per_ortho_pixel(H_frame_ortho, camera))
    H_small_ortho = H_frame_ortho @ np.linalg.inv(H_frame_small)
    warped = cv2.warpPerspective(small, H_small_ortho, size_px, flags=cv2.INTER_LINEAR)
    valid = _valid(H_frame_ortho, seen, H_small_ortho, small.shape, size_px)
    picture = np.where(valid, np.asarray(warped, dtype=np.float32), np.float32(0.0))
    return Ortho(picture, valid, gsd_m, H_frame_ortho, nadir_px)


def _has_texture(image: ImageArray) -> bool:
    """Tell whether a frame's values deviate from their mean at all.

    Two values ``r`` apart among ``n`` make a deviation of at least ``r / sqrt(2 n)``, so that the
    range alone settles it for all but nearly constant frames.
    """
    spread = float(image.max()) - float(image.min())
    if math.isfinite(spread) and spread > 2 * _MIN_DEVIATION * math.sqrt(2 * image.size):
        return True
    return float(image.std(dtype=np.float64)) > _MIN_DEVIATION


def _plan(
    camera: CameraModel, prior: Prior, gsd_m: float, multiple_px: int
) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Return ``H_frame_ortho``, the nadir in ortho pixels, and the ortho's (width, height)."""
    tilt_deg = math.degrees(tilt_rad(prior.attitude))
    if tilt_deg > MAX_TILT_DEG:
        raise ObliqueFrameError(f"tilted by {tilt_deg:.0f}°; at most {MAX_TILT_DEG:.0f}° are used")
    height_m = prior.height_above_ground_m
    if not (math.isfinite(height_m) and height_m > 0):
        raise FootprintSizeError(f"no footprint from {height_m:.1f} m above the ground")
    try:
        H_frame_ground = homography_frame_ground(camera, prior.attitude, height_m)
    except HorizonError as error:
        raise ObliqueFrameError(str(error)) from error
    corners_m = transform_points(
        H_frame_ground, image_corners_px(camera.width_px, camera.height_px)
    )
    corners_px = corners_m / (gsd_m, -gsd_m)
    first, last = np.floor(corners_px.min(axis=0)), np.ceil(corners_px.max(axis=0))
    needed = last - first + 1
    if needed.min() < _MIN_ORTHO_PX or needed.max() > _MAX_ORTHO_PX:
        raise FootprintSizeError(
            f"the footprint from {height_m:.1f} m is {needed[0]:.0f} × {needed[1]:.0f} pixels"
            f" of {gsd_m:g} m; {_MIN_ORTHO_PX} to {_MAX_ORTHO_PX} are sensible"
        )
    size = np.ceil(needed / multiple_px).astype(int) * multiple_px
    nadir_px = (size - needed) // 2 - first
    H_ground_ortho = np.array(
        [[1 / gsd_m, 0.0, nadir_px[0]], [0.0, -1 / gsd_m, nadir_px[1]], [0.0, 0.0, 1.0]]
    )
    H: FloatArray = H_ground_ortho @ H_frame_ground
    return H / float(H[2, 2]), nadir_px, (int(size[0]), int(size[1]))


def _frame_pixels_per_ortho_pixel(H_frame_ortho: FloatArray, camera: CameraModel) -> float:
    """Return how many frame pixels (as a length) an ortho pixel spans in the frame's middle."""
    middle = np.array([camera.width_px, camera.height_px]) / 2 - 0.5
    around = middle + np.array([[-0.5, 0.0], [0.5, 0.0], [0.0, -0.5], [0.0, 0.5]])
    left, right, above, below = transform_points(H_frame_ortho, around)
    return 1.0 / math.sqrt(abs(float(np.linalg.det(np.stack([right - left, below - above])))))


def _reduce(image: ImageArray, ratio: float) -> tuple[ImageArray, FloatArray]:
    """Return a frame without detail finer than ``ratio`` of its pixels, and ``H_frame_reduced``.

    A Gaussian of 0.45 ``ratio`` pixels; where that is wide, area averaging does most of it first.
    """
    height_px, width_px = image.shape
    if ratio <= 1.0:
        return image, np.eye(3)
    factor = max(1, int(ratio / 2))
    size_px = (max(1, round(width_px / factor)), max(1, round(height_px / factor)))
    small = cv2.resize(image, size_px, interpolation=cv2.INTER_AREA) if factor > 1 else image
    box_px = factor if factor > 1 else 0
    variance_px2 = (_BLUR_PER_RATIO * ratio) ** 2 - (_BOX_DEVIATION * box_px) ** 2
    blurred = cv2.GaussianBlur(small, (0, 0), math.sqrt(variance_px2) / factor)
    return np.asarray(blurred, dtype=np.float32), resize_homography((width_px, height_px), size_px)


def _valid(
    H_frame_ortho: FloatArray,
    seen: BoolArray | None,
    H_small_ortho: FloatArray,
    small_shape: tuple[int, ...],
    size_px: tuple[int, int],
) -> BoolArray:
    """Return which ortho pixels were interpolated from pixels that the frame really has.

    ``seen`` None: the frame has all of its pixels. A source position ``(u / w, v / w)`` is within a
    bound where ``u - bound * w`` has the right sign, which is linear in the ortho's pixels: nothing
    needs to be divided.
    """
    u, v, w = np.linalg.inv(H_small_ortho)
    right, bottom = small_shape[1] - 1.0, small_shape[0] - 1.0
    margin = _BORDER_MARGIN_PX
    x, y = np.arange(size_px[0], dtype=np.float64), np.arange(size_px[1], dtype=np.float64)
    valid: BoolArray = np.ones(size_px[::-1], dtype=np.bool_)
    sides = (u - margin * w, (right - margin) * w - u, v - margin * w, (bottom - margin) * w - v)
    for along_x, along_y, constant in (w, *sides):
        valid &= np.add.outer(along_y * y + constant, along_x * x) >= 0.0
    if seen is not None and not seen.all():
        shown = cv2.warpPerspective(
            seen.astype(np.float32), H_frame_ortho, size_px, flags=cv2.INTER_LINEAR
        )
        valid = valid & (shown > 1.0 - 1e-6)
    return valid


def _undistort(image: ImageArray, camera: CameraModel) -> tuple[ImageArray, BoolArray]:
    """Return a frame without distortion, and which of its pixels the original has."""
    map_x, map_y = _undistortion_maps(camera)
    straight = cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside: BoolArray = (map_x >= 0) & (map_x <= camera.width_px - 1)
    inside &= (map_y >= 0) & (map_y <= camera.height_px - 1)
    return np.asarray(straight, dtype=np.float32), inside


@lru_cache(maxsize=4)
def _undistortion_maps(camera: CameraModel) -> tuple[NDArray[Any], NDArray[Any]]:
    K = camera_matrix(camera)
    size_px = (camera.width_px, camera.height_px)
    map_x, map_y = cv2.initUndistortRectifyMap(
        K, distortion_coefficients(camera), None, K, size_px, cv2.CV_32FC1
    )
    return map_x, map_y
