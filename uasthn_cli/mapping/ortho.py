"""Rectify a frame to flat ground or to relief: north-up, at the GSD of the map."""

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
from uasthn_cli.geometry.surface import CameraOverSurface
from uasthn_cli.types import BoolArray, CameraModel, FloatArray, ImageArray, Ortho, Prior

_MIN_ORTHO_PX = 8
_MAX_ORTHO_PX = 4096
_MIN_DEVIATION = 1e-6
_BLUR_PER_RATIO = 0.45
_BOX_DEVIATION = 1 / math.sqrt(12)
_OUTLINE_POINTS = 9
_BORDER_MARGIN_PX = 1 / 16
"""``warpPerspective`` rounds source positions to 1/32 pixel."""


class ObliqueFrameError(ValueError):
    """The frame is tilted too far, or sees the horizon."""


class TexturelessFrameError(ValueError):
    """The frame has the same value everywhere."""


class FootprintSizeError(ValueError):
    """The frame's footprint has no sensible size at this height and GSD."""


def rectify(
    image: ImageArray,
    camera: CameraModel,
    prior: Prior,
    gsd_m: float,
    *,
    multiple_px: int = 1,
    over: CameraOverSurface | None = None,
) -> Ortho:
    """Return a frame ``(h, w)`` as the north-up picture of the ground that the prior implies.

    The ortho is just large enough for the footprint, its sides rounded up to ``multiple_px``.
    ``H_frame_ortho`` takes pixels of the undistorted frame (same camera matrix). With ``over``, the
    same camera over relief, the picture shows each place where it lies, whatever its height;
    ``H_frame_ortho`` remains that of flat ground.

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
    H_frame_ortho, nadir_px, size_px = _plan(camera, prior, gsd_m, multiple_px, over)
    seen = None
    if any(camera.distortion):
        image, seen = _undistort(image, camera)
    small, H_frame_small = _reduce(image, _frame_pixels_per_ortho_pixel(H_frame_ortho, camera))
    if over is not None:
        frame_px = over.to_frame(_places_m(over, gsd_m, nadir_px, size_px))
        picture, valid = _sampled(small, H_frame_small, seen, frame_px)
        return Ortho(picture, valid, gsd_m, H_frame_ortho, nadir_px)
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
    camera: CameraModel,
    prior: Prior,
    gsd_m: float,
    multiple_px: int,
    over: CameraOverSurface | None,
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
    outline_px = _outline_m(camera, H_frame_ground, over) / (gsd_m, -gsd_m)
    first, last = np.floor(outline_px.min(axis=0)), np.ceil(outline_px.max(axis=0))
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


def _outline_m(
    camera: CameraModel, H_frame_ground: FloatArray, over: CameraOverSurface | None
) -> FloatArray:
    """Return places ``(n, 2)`` that enclose the footprint, from the point below the camera."""
    corners_px = image_corners_px(camera.width_px, camera.height_px)
    if over is None:
        return transform_points(H_frame_ground, corners_px)
    share = np.linspace(0.0, 1.0, _OUTLINE_POINTS)[:, None]
    starts, ends = corners_px[[0, 2, 0, 1]], corners_px[[1, 3, 2, 3]]
    outline_px = (starts + share[..., None] * (ends - starts)).reshape(-1, 2)
    return over.to_ground(outline_px) - over.position_m


def _places_m(
    over: CameraOverSurface, gsd_m: float, nadir_px: FloatArray, size_px: tuple[int, int]
) -> FloatArray:
    """Return the places ``(h, w, 2)`` of an ortho's pixels."""
    x, y = np.meshgrid(np.arange(size_px[0]), np.arange(size_px[1]))
    ortho_px = np.stack([x, y], axis=-1)
    return np.asarray(over.position_m + (ortho_px - nadir_px) * (gsd_m, -gsd_m))


def _sampled(
    small: ImageArray, H_frame_small: FloatArray, seen: BoolArray | None, frame_px: FloatArray
) -> tuple[ImageArray, BoolArray]:
    """Return a reduced frame at frame pixels ``(h, w, 2)``, and which of these it really has."""
    # far outside rather than NaN, which OpenCV takes for any pixel
    frame_px = np.where(np.isfinite(frame_px), frame_px, -1e6)
    small_px = transform_points(H_frame_small, frame_px)
    last = np.array([small.shape[1], small.shape[0]]) - 1.0
    margin = _BORDER_MARGIN_PX
    valid = ((small_px >= margin) & (small_px <= last - margin)).all(axis=-1)
    if seen is not None and not seen.all():
        valid &= _remapped(seen.astype(np.float32), frame_px) > 1.0 - 1e-6
    picture = np.where(valid, _remapped(small, small_px), np.float32(0.0))
    return picture, np.asarray(valid, np.bool_)


def _remapped(image: ImageArray, points_px: FloatArray) -> ImageArray:
    """Return an image's values at points ``(h, w, 2)``, bilinear."""
    x, y = np.ascontiguousarray(np.moveaxis(points_px, -1, 0), dtype=np.float32)
    sampled = cv2.remap(image, x, y, cv2.INTER_LINEAR)
    return np.asarray(sampled, dtype=np.float32)


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
