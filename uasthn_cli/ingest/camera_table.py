"""Thermal cameras by name: array, pixel pitch, lens, and where each number comes from.

Focal lengths are the makers' nominal ones. A pinhole of that focal length is what the frame's
centre sees; lenses wider than 60° also need ``--distortion`` to be right at the corners.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class NamedCamera:
    """One row of the table; ``exif_model`` is what the camera writes into EXIF ``Model``."""

    name: str
    width_px: int
    height_px: int
    pixel_pitch_um: float
    focal_mm: float
    source: str
    exif_model: str | None = None


_BOSON: Final = (
    "FLIR Boson datasheet 102-2013-40 Rev 340: 12 µm; effective focal length by configuration"
)
_VUE_PRO: Final = "FLIR Vue Pro / Vue Pro R user guide, specifications: 17 µm; focal length by lens"
_XT2: Final = "DJI Zenmuse XT2 specifications: 640 × 512, 17 µm; focal length by lens"


def _series(
    prefix: str,
    size_px: tuple[int, int],
    pitch_um: float,
    lenses_mm: tuple[float, ...],
    source: str,
) -> Iterator[NamedCamera]:
    for focal_mm in lenses_mm:
        yield NamedCamera(f"{prefix}-{focal_mm:g}mm", *size_px, pitch_um, focal_mm, source)


CAMERAS: Final[tuple[NamedCamera, ...]] = (
    *_series("boson640", (640, 512), 12.0, (4.9, 8.7, 14.0, 18.0, 24.0, 36.0, 55.0), _BOSON),
    *_series("boson320", (320, 256), 12.0, (2.3, 4.3, 6.3, 9.1, 13.8, 18.0, 36.0, 55.0), _BOSON),
    *_series("vuepro640", (640, 512), 17.0, (9.0, 13.0, 19.0), _VUE_PRO),
    *_series("vuepro336", (336, 256), 17.0, (6.8, 9.0, 13.0), _VUE_PRO),
    *_series("xt2", (640, 512), 17.0, (9.0, 13.0, 19.0, 25.0), _XT2),
    NamedCamera(
        "h20t",
        640,
        512,
        12.0,
        13.5,
        "DJI Zenmuse H20 series specifications: 640 × 512, 12 µm, 13.5 mm (equivalent 58 mm)",
        exif_model="ZH20T",
    ),
    NamedCamera(
        "m30t",
        640,
        512,
        12.0,
        9.1,
        "DJI Matrice 30 series specifications: 640 × 512, 12 µm, 9.1 mm (equivalent 40 mm);"
        " frames of 1280 × 1024 are upsampled",
        exif_model="M30T",
    ),
    NamedCamera(
        "m3t",
        640,
        512,
        12.0,
        9.1,
        "DJI Mavic 3 Enterprise series specifications: 640 × 512, 12 µm, 9.1 mm (equivalent 40 mm)",
        exif_model="M3T",
    ),
    NamedCamera(
        "m2ea",
        640,
        512,
        12.0,
        9.0,
        "DJI Mavic 2 Enterprise Advanced specifications: 640 × 512, 12 µm, about 9 mm"
        " (equivalent 38 mm)",
        exif_model="MAVIC2-ENTERPRISE-ADVANCED",
    ),
)
"""All named cameras, in the order in which they are listed."""

EXIF_PITCH_UM: Final[dict[str, tuple[int, float]]] = {
    "XT2": (640, 17.0),
    **{
        camera.exif_model: (camera.width_px, camera.pixel_pitch_um)
        for camera in CAMERAS
        if camera.exif_model is not None
    },
}
"""Native width in pixels and pixel pitch by EXIF ``Model``.

EXIF's own FocalPlaneXResolution is not used: the XT2 writes 3.84 where 58.8 pixels/mm are meant.
"""


def normalised(name: str) -> str:
    """Return a camera's name as it is compared: lower case, letters, digits and points only."""
    return "".join(sign for sign in name.casefold() if sign.isalnum() or sign == ".")


def find_camera(name: str) -> NamedCamera | None:
    """Return a camera by name, whatever its case, spaces and hyphens; None if it is unknown."""
    wanted = normalised(name)
    return next((camera for camera in CAMERAS if normalised(camera.name) == wanted), None)
