"""From what a user knows of a camera to a pinhole model for frames of a given size."""

import functools
import logging
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from uasthn_cli.errors import CameraError
from uasthn_cli.geometry.camera import focal_from_hfov_px
from uasthn_cli.ingest.camera_table import (
    CAMERAS,
    EXIF_PITCH_UM,
    NamedCamera,
    find_camera,
)
from uasthn_cli.ingest.exif import ExifFacts, read_exif
from uasthn_cli.ingest.frames import UnreadableFrameError
from uasthn_cli.types import CameraModel

__all__ = ["CAMERAS", "CameraSpec", "FocalLengthUnknownError", "FrameSizeError", "NamedCamera"]

_log = logging.getLogger(__name__)

_DISTORTION_COUNTS: Final = (0, 4, 5, 8, 12, 14)
_ASPECT_TOLERANCE = 0.01
_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)


class FrameSizeError(UnreadableFrameError):
    """A frame's shape is not the camera's, so that its field of view is unknown."""


class FocalLengthUnknownError(UnreadableFrameError):
    """A frame's EXIF was to tell the focal length and does not."""


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """A camera as the user describes it, free of the frames' size.

    One of: ``hfov_deg`` across the full width; ``focal_mm`` with ``pixel_pitch_um``; the ``name``
    of a row of :data:`~uasthn_cli.ingest.camera_table.CAMERAS`; or nothing, for the focal length in
    EXIF. ``distortion`` holds OpenCV's coefficients. ``mount_yaw_deg`` turns the camera clockwise
    seen from above, ``mount_pitch_deg`` and ``mount_roll_deg`` then tilt it as they would the
    aircraft. The principal point is the middle of the frame.

    Raises:
        CameraError: the description is contradictory, incomplete, or names an unknown camera.
    """

    hfov_deg: float | None = None
    focal_mm: float | None = None
    pixel_pitch_um: float | None = None
    name: str | None = None
    distortion: tuple[float, ...] = ()
    mount_yaw_deg: float = 0.0
    mount_roll_deg: float = 0.0
    mount_pitch_deg: float = 0.0

    def __post_init__(self) -> None:
        """Check the description."""
        ways = (self.hfov_deg, self.focal_mm, self.name)
        if sum(way is not None for way in ways) > 1:
            raise CameraError("give only one of field of view, focal length and camera name")
        if (self.focal_mm is None) != (self.pixel_pitch_um is None):
            raise CameraError("focal length (mm) and pixel pitch (µm) go together; give both")
        if self.hfov_deg is not None and not 0.0 < self.hfov_deg < 180.0:
            raise CameraError(f"a field of view of {self.hfov_deg:g}° is not between 0° and 180°")
        for value in (self.focal_mm, self.pixel_pitch_um):
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise CameraError(f"focal length and pixel pitch must be above 0, not {value:g}")
        if len(self.distortion) not in _DISTORTION_COUNTS:
            raise CameraError(
                f"{len(self.distortion)} distortion coefficients; OpenCV's models take"
                f" {', '.join(map(str, _DISTORTION_COUNTS[1:]))}"
            )
        if self.name is not None and find_camera(self.name) is None:
            known = ", ".join(camera.name for camera in CAMERAS)
            raise CameraError(f"no camera is called {self.name!r}; known: {known}")

    def model(self, width_px: int, height_px: int, exif: ExifFacts | None = None) -> CameraModel:
        """Return the pinhole model for frames of one size.

        Raises:
            CameraError: neither the description nor EXIF tells a focal length.
            FrameSizeError: the frame has not the shape of the named camera's array.
        """
        focal_px = self._focal_px(width_px, height_px, exif or ExifFacts())
        return CameraModel(
            width_px=width_px,
            height_px=height_px,
            focal_x_px=focal_px,
            focal_y_px=focal_px,
            principal_x_px=(width_px - 1) / 2.0,
            principal_y_px=(height_px - 1) / 2.0,
            distortion=self.distortion,
            mount_yaw_rad=math.radians(self.mount_yaw_deg),
            mount_roll_rad=math.radians(self.mount_roll_deg),
            mount_pitch_rad=math.radians(self.mount_pitch_deg),
        )

    def model_of_frame(self, path: Path, width_px: int, height_px: int) -> CameraModel:
        """Return the pinhole model for one frame, whose EXIF is read if nothing else is given.

        Raises:
            FocalLengthUnknownError: neither the description nor the frame's EXIF tells one.
            FrameSizeError: the frame has not the shape of the named camera's array.
        """
        needs_exif = self.hfov_deg is None and self.focal_mm is None and self.name is None
        try:
            return self.model(width_px, height_px, read_exif(path) if needs_exif else None)
        except CameraError as error:
            raise FocalLengthUnknownError(str(error)) from error

    def _focal_px(self, width_px: int, height_px: int, exif: ExifFacts) -> float:
        if self.hfov_deg is not None:
            return focal_from_hfov_px(width_px, self.hfov_deg)
        if self.focal_mm is not None and self.pixel_pitch_um is not None:
            return self.focal_mm * 1e3 / self.pixel_pitch_um
        camera = find_camera(self.name) if self.name is not None else None
        if camera is not None:
            return _focal_of_named_px(camera, width_px, height_px)
        return _focal_of_exif_px(exif, width_px, height_px)


def _focal_of_named_px(camera: NamedCamera, width_px: int, height_px: int) -> float:
    """Return the focal length of a named camera in pixels of a frame of the array's shape."""
    native_aspect = camera.width_px / camera.height_px
    if abs(width_px / height_px / native_aspect - 1.0) > _ASPECT_TOLERANCE:
        raise FrameSizeError(
            f"{width_px} × {height_px} px is not the shape of {camera.name}"
            f" ({camera.width_px} × {camera.height_px}); give --hfov for cropped frames"
        )
    if width_px != camera.width_px:
        _report_scaling(camera.name, camera.width_px, width_px)
    return camera.focal_mm * 1e3 / camera.pixel_pitch_um * width_px / camera.width_px


@functools.cache
def _report_scaling(name: str, native_width_px: int, width_px: int) -> None:
    """Say once that frames are larger or smaller than the camera's array."""
    _log.warning(
        "frames are %d px wide, the array of %s %d px: taken as resampled, not cropped",
        width_px,
        name,
        native_width_px,
    )


def _focal_of_exif_px(exif: ExifFacts, width_px: int, height_px: int) -> float:
    """Return the focal length from EXIF: by a known pixel pitch, else by the equivalent of 35 mm.

    The equivalent refers to the diagonal (CIPA DCG-001): 58 mm gives the H20T 1099 px where its
    pitch gives 1125 px, so the pitch is preferred where it is known.
    """
    known = EXIF_PITCH_UM.get(exif.model or "")
    if exif.focal_mm is not None and known is not None:
        native_width_px, pitch_um = known
        return exif.focal_mm * 1e3 / pitch_um * width_px / native_width_px
    if exif.focal_35mm_mm is not None:
        return exif.focal_35mm_mm / _FULL_FRAME_DIAGONAL_MM * math.hypot(width_px, height_px)
    raise CameraError(
        "the camera's field of view is unknown and EXIF does not tell it; give --hfov DEG,"
        " --focal-mm with --pixel-pitch-um, or --camera NAME"
    )
