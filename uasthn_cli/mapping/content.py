"""What a map's files hold, as a hash: for maps that are hashed faster than they are read."""

import hashlib
from pathlib import Path

import cv2
import numpy as np
import rasterio

from uasthn_cli.config import MAX_HASHED_BYTES
from uasthn_cli.mapping.raster import gdal_errors, open_source
from uasthn_cli.version import code_sha256

_DRIVERS_OF_PIXELS = frozenset({"GTiff", "COG", "PNG", "JPEG", "BMP", "GPKG", "JP2OpenJPEG"})
"""Formats whose pixels lie in the files that GDAL lists; a virtual raster's may lie anywhere."""

_READ_WITH = (rasterio.__version__, rasterio.__gdal_version__, np.__version__, cv2.__version__)
"""Versions of what reads the pixels: another may read them otherwise."""


def content_sha256(path: Path) -> str | None:
    """Return a hash of all files of a map and of the code that reads them.

    None where that would take longer than reading windows: of large maps and of virtual rasters,
    whose pixels lie in other files.

    Raises:
        MapUnreadableError: missing, corrupt, or not a raster that GDAL reads.
        MapWithoutCrsError: the map does not say where on earth it lies.
    """
    with gdal_errors(path, "read"), open_source(path).dataset as dataset:
        files = [Path(name) for name in sorted(dataset.files)]
        has_pixels = dataset.driver in _DRIVERS_OF_PIXELS
    if not (has_pixels and files):
        return None
    try:
        if sum(file.stat().st_size for file in files) > MAX_HASHED_BYTES:
            return None
        hashed = hashlib.sha256(repr((code_sha256(), *_READ_WITH)).encode())
        for file in files:
            with file.open("rb") as content:
                hashed.update(hashlib.file_digest(content, "sha256").digest())
    except OSError:
        return None
    return hashed.hexdigest()
