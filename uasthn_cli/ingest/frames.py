"""The frames on disk: which there are, and their pixels."""

import re
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFile, UnidentifiedImageError

from uasthn_cli.errors import FramesError
from uasthn_cli.types import FrameFile, ImageArray

SUFFIXES: Final = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff"})
_FORMATS: Final = ("PNG", "JPEG", "MPO", "TIFF")

_LOW_PERCENT, _HIGH_PERCENT = 0.5, 99.5
"""Radiometric counts between these percentiles become 0..1: hot spots must not darken the rest."""

_GREY_WEIGHTS: Final = np.array([0.299, 0.587, 0.114], dtype=np.float32)  # ITU-R BT.601

_DECODE_ERRORS: Final = (
    OSError,
    SyntaxError,
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    EOFError,
    OverflowError,
    MemoryError,
    Image.DecompressionBombError,
)
"""What Pillow raises on damaged files, by format (broken PNG chunks are SyntaxErrors)."""


class UnreadableFrameError(ValueError):
    """A frame cannot be decoded whole; the message is one short line without its path."""


def list_frames(folder: Path) -> list[FrameFile]:
    """Return all PNG, JPEG and TIFF files below a folder, in natural order of their names.

    Hidden files and folders (leading dot) are left out.

    Raises:
        FramesError: the folder is missing, is a file, or holds no image.
    """
    if not folder.exists():
        raise FramesError(f"{folder} does not exist; give the folder of frames")
    if not folder.is_dir():
        raise FramesError(f"{folder} is a file; give the folder that holds the frames")
    try:
        files = [path for path in folder.rglob("*") if path.is_file()]
    except OSError as error:
        raise FramesError(f"{folder} cannot be read: {error.strerror or error}") from error
    named = [FrameFile(path.relative_to(folder).as_posix(), path) for path in files]
    shown = [frame for frame in named if not re.search(r"(^|/)\.", frame.name)]
    frames = [frame for frame in shown if frame.path.suffix.lower() in SUFFIXES]
    if not frames:
        raise FramesError(f"{folder} holds no PNG, JPEG or TIFF frame ({_describe(shown)})")
    return sorted(frames, key=lambda frame: _natural_key(frame.name))


def read_frame(path: Path) -> ImageArray:
    """Return a frame's pixels ``(h, w)`` as grey values in 0..1.

    8-bit values are divided by 255; 16-bit and floating-point (radiometric) ones are stretched
    between robust percentiles of the frame. Colour becomes luma, alpha is dropped. EXIF orientation
    is *not* applied: rows and columns stay those of the sensor, which the camera model describes.

    Raises:
        UnreadableFrameError: the file is empty, truncated, damaged or of another kind.
    """
    with _opened(path) as image:
        pixels = _deep_colour(image, path) if _is_deep_colour(image) else _decode(image)
    radiometric = pixels.dtype != np.uint8
    if pixels.ndim == 2 and not radiometric:
        return np.asarray(np.divide(pixels, np.float32(255.0), dtype=np.float32))
    grey = pixels.astype(np.float32)
    if grey.ndim == 3:
        grey = grey @ _GREY_WEIGHTS
    return _stretch(grey) if radiometric else grey / np.float32(255.0)


def frame_size_px(path: Path) -> tuple[int, int]:
    """Return a frame's ``(width, height)`` from its header alone.

    Raises:
        UnreadableFrameError: the file is empty or not an image.
    """
    with _opened(path) as image:
        width_px, height_px = image.size
        return int(width_px), int(height_px)


@contextmanager
def _opened(path: Path) -> Iterator[Image.Image]:
    """Open an image with Pillow, which reads strictly: OpenCV fills truncated files up silently."""
    try:
        if path.stat().st_size == 0:
            raise UnreadableFrameError("empty file (0 bytes)")
        # Pillow's warnings about metadata are noise: what matters becomes the frame's row.
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:
            if image.format not in _FORMATS:
                raise UnreadableFrameError(f"{image.format} image; PNG, JPEG and TIFF are read")
            yield image
    except UnreadableFrameError:
        raise
    except UnidentifiedImageError as error:
        raise UnreadableFrameError("not a PNG, JPEG or TIFF image") from error
    except _DECODE_ERRORS as error:
        detail = " ".join(str(error).split()) or type(error).__name__
        raise UnreadableFrameError(f"damaged or truncated image: {detail}") from error


def _decode(image: Image.Image) -> NDArray[Any]:
    """Return pixels ``(h, w)`` or ``(h, w, 3)``: uint8, or wider for radiometric frames."""
    if image.mode in {"L", "RGB", "F"} or image.mode.startswith("I"):
        return np.asarray(image)
    if image.mode in {"LA", "1", "La"}:
        return np.asarray(image.convert("L"))
    return np.asarray(image.convert("RGB"))


def _is_deep_colour(image: Image.Image) -> bool:
    """Tell whether Pillow would cut 16-bit colour down to 8 bits."""
    tiles = image.tile if isinstance(image, ImageFile.ImageFile) else []
    return image.mode in {"RGB", "RGBA"} and any(";16" in str(tile[3]) for tile in tiles)


def _deep_colour(image: Image.Image, path: Path) -> NDArray[Any]:
    """Return 16-bit colour ``(h, w, 3)`` by OpenCV, after Pillow has read the file to its end."""
    image.load()
    decoded = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if decoded is None or decoded.ndim != 3:
        raise UnreadableFrameError("16-bit colour image of an unknown layout")
    return np.asarray(decoded)[..., 2::-1]


def _stretch(values: ImageArray) -> ImageArray:
    """Scale values between two percentiles to 0..1; values that are not finite become 0."""
    finite = np.isfinite(values)
    if not finite.any():
        raise UnreadableFrameError("no finite pixel value")
    low, high = np.percentile(values[finite], (_LOW_PERCENT, _HIGH_PERCENT))
    scaled = (np.where(finite, values, low) - low) / max(float(high - low), 1e-6)
    stretched: ImageArray = np.clip(scaled, 0.0, 1.0).astype(np.float32)
    return stretched


def _natural_key(name: str) -> tuple[list[tuple[bool, int, str]], str]:
    """Return a sort key by which ``frame_10`` follows ``frame_9``."""
    parts = re.split(r"(\d+)", name.casefold())
    return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts], name


def _describe(files: list[FrameFile]) -> str:
    """Say what kinds of files are in a folder without frames."""
    if not files:
        return "it is empty"
    kinds = Counter(frame.path.suffix.lower() or "without extension" for frame in files)
    seen = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(3))
    return f"{len(files)} file{'s' if len(files) > 1 else ''} seen: {seen}"
