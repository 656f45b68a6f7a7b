"""What a map's files hold, as a hash: for maps that are hashed faster than they are read."""

import hashlib
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import rasterio

from uasthn_cli.config import MAX_HASHED_BYTES

_DRIVERS_OF_PIXELS = frozenset({"GTiff", "COG", "PNG", "JPEG", "BMP", "GPKG", "JP2OpenJPEG"})
"""Formats whose pixels lie in the files that GDAL lists; a virtual raster's may lie anywhere."""


def content_sha256(dataset: rasterio.DatasetReader) -> str | None:
    """Return a hash of all files of a map and of the code that reads them; None if not sensible."""
    files = [Path(name) for name in sorted(dataset.files)]
    if dataset.driver not in _DRIVERS_OF_PIXELS or not files:
        return None
    try:
        if sum(file.stat().st_size for file in files) > MAX_HASHED_BYTES:
            return None
        hashed = hashlib.sha256(_code_sha256().encode())
        for file in files:
            with file.open("rb") as content:
                hashed.update(hashlib.file_digest(content, "sha256").digest())
    except OSError:
        return None
    return hashed.hexdigest()


@cache
def _code_sha256() -> str:
    """Return a hash of this room's code and of the versions of what it reads maps with."""
    versions = (rasterio.__version__, rasterio.__gdal_version__, np.__version__, cv2.__version__)
    hashed = hashlib.sha256(repr(versions).encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        hashed.update(path.name.encode() + b"\0" + path.read_bytes())
    return hashed.hexdigest()
