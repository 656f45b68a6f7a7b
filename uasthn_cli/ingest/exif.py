"""What a frame's EXIF says about the camera and the moment of exposure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from PIL import ExifTags, Image

from uasthn_cli.ingest.timestamps import StatedTime, parse_time

_EXIF_ERRORS: Final = (OSError, SyntaxError, ValueError, KeyError, TypeError, EOFError)
"""What Pillow raises on damaged headers, beside its own UnidentifiedImageError (an OSError)."""


@dataclass(frozen=True, slots=True)
class ExifFacts:
    """EXIF of one frame; None where a field is absent or void.

    ``focal_35mm_mm`` is the focal length of a 36 × 24 mm camera of the same diagonal field of view.
    """

    model: str | None = None
    focal_mm: float | None = None
    focal_35mm_mm: float | None = None
    taken: StatedTime | None = None


def read_exif(path: Path) -> ExifFacts:
    """Return a frame's EXIF; all fields are None for a file without, or one that cannot be read."""
    try:
        with Image.open(path) as image:
            exif = image.getexif()
            detail = exif.get_ifd(ExifTags.IFD.Exif)
            model = exif.get(ExifTags.Base.Model)
    except _EXIF_ERRORS:
        return ExifFacts()
    return ExifFacts(
        model=_text(model),
        focal_mm=_positive(detail.get(ExifTags.Base.FocalLength)),
        focal_35mm_mm=_positive(detail.get(ExifTags.Base.FocalLengthIn35mmFilm)),
        taken=_taken(detail),
    )


def _taken(detail: Mapping[int, Any]) -> StatedTime | None:
    """Return DateTimeOriginal with its sub-seconds and its offset from UTC (EXIF 2.31)."""
    text = _text(detail.get(ExifTags.Base.DateTimeOriginal))
    if text is None:
        return None
    subseconds = _text(detail.get(ExifTags.Base.SubsecTimeOriginal)) or ""
    fraction = f".{subseconds}" if subseconds.isdecimal() else ""
    offset = _text(detail.get(ExifTags.Base.OffsetTimeOriginal)) or ""
    return parse_time(text + fraction + offset) or parse_time(text + fraction)


def _text(value: object) -> str | None:
    """Return a text field without padding, None if void or not a text."""
    if not isinstance(value, str):
        return None
    return value.strip("\0 ") or None


def _positive(value: object) -> float | None:
    """Return a rational as a number, None if void, zero or not finite."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0.0 else None
