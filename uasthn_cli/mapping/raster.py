"""Opening maps: which bands to show, which overview to read, and errors in one line.

GDAL's own ``WarpedVRT`` neither picks overviews of its source nor splits a block that covers much
more source than memory should hold (measured: 2 GB for a 512 × 512 window at a hundredth of the
resolution), so windows are warped piece by piece instead, from the overview that fits.
"""

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
import rasterio
from affine import Affine
from rasterio.crs import CRS
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioError
from rasterio.transform import from_gcps
from rasterio.warp import reproject

from uasthn_cli.errors import MapUnreadableError, MapWithoutCrsError
from uasthn_cli.geometry.pixels import box_corner_transform
from uasthn_cli.mapping.georeference import Georeference
from uasthn_cli.types import BoolArray, FloatArray, GridBox, ImageArray, MapGrid

_log = logging.getLogger(__name__)

MAP: Final = "map"
"""What messages call a raster, unless they are told otherwise."""

_BLOCK_CACHE_BYTES = 64 * 2**20
_WARP_MEMORY_MB = 64
_WARP_TOLERANCE_PX = 0.02
_HALF_COVERED = 127.5
_MIN_GSD_M, _MAX_GSD_M = 1e-4, 1e5


@dataclass(frozen=True, slots=True)
class MapSource:
    """An open map: the GDAL dataset, where it lies, and the bands that make its colours.

    ``colour_bands`` has one number (grey) or three (red, green, blue); ``alpha_band`` is 0 where
    the map has none. Band numbers count from 1.
    """

    dataset: rasterio.DatasetReader
    place: Georeference
    colour_bands: tuple[int, ...]
    alpha_band: int


@contextmanager
def gdal_errors(path: Path, doing: str, what: str = MAP) -> Iterator[None]:
    """Run GDAL with a small block cache; turn what it raises into one line.

    Raises:
        MapUnreadableError: GDAL failed while ``doing`` something with the map, or ``what`` it is.
    """
    try:
        with rasterio.Env(GDAL_CACHEMAX=_BLOCK_CACHE_BYTES):
            yield
    except (RasterioError, CRSError) as error:
        detail = " ".join(str(error.__cause__ or error).split())
        raise MapUnreadableError(f"{path}: cannot {doing} the {what} ({detail})") from error


def open_source(path: Path, overview_level: int | None = None, what: str = MAP) -> MapSource:
    """Open a map, at full resolution or at one of its overviews; messages call it ``what``.

    Raises:
        MapUnreadableError: missing, corrupt, or not a raster that GDAL reads.
        MapWithoutCrsError: the map does not say where on earth it lies.
    """
    if not path.exists():
        raise MapUnreadableError(f"{path}: no such {what}")
    with gdal_errors(path, "open", what), warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        level = {} if overview_level is None else {"overview_level": overview_level}
        dataset = rasterio.open(path, **level)
        if dataset.count == 0:
            raise MapUnreadableError(_several_images(dataset, path, what))
        place = _georeference(dataset, path, what)
        if ColorInterp.palette in dataset.colorinterp:
            expanded = rasterio.open(_palette_vrt(dataset, place, path, overview_level))
            dataset.close()
            return MapSource(expanded, place, (1, 2, 3), 4)
        return MapSource(dataset, place, *_choose_bands(dataset.colorinterp))


def fitting_overview(overviews: Sequence[int], full_gsd_m: float, gsd_m: float) -> int | None:
    """Return the index of the coarsest overview that is still as fine as ``gsd_m``, or None.

    ``overviews`` are factors by which they are smaller; damaged files have factors of 0.
    """
    fine_enough = [k for k, factor in enumerate(overviews) if 1 < factor <= gsd_m / full_gsd_m]
    return max(fine_enough, key=lambda k: overviews[k], default=None)


def warp(
    source: MapSource, crs: CRS, pixel_m: FloatArray, grid: MapGrid, box: GridBox
) -> tuple[ImageArray, BoolArray]:
    """Read a box of the grid: raw values ``(h, w, 1 or 3)`` and which of them are valid ``(h, w)``.

    Bilinear; where the map is finer than the grid, GDAL widens the kernel to all the map pixels
    concerned, so nothing aliases. ``crs`` is the grid's CRS and ``pixel_m`` the metres ``(2, 2)``
    per map pixel, which fixes that width for the whole flight (GDAL would guess it per piece).
    """
    bands = source.colour_bands
    # rasterio writes band k of the source into plane k of the target, whatever the order asked for
    planes = np.zeros((max(bands) + 1, box.height_px, box.width_px), dtype=np.float32)
    west, north, _, _ = box_corner_transform(grid, box)
    scale_x, scale_y = np.linalg.norm(pixel_m, axis=0) / grid.gsd_m
    reproject(
        rasterio.band(source.dataset, list(bands)),
        planes,
        dst_transform=Affine(grid.gsd_m, 0.0, west, 0.0, -grid.gsd_m, north),
        dst_crs=crs,
        dst_nodata=0,
        src_alpha=source.alpha_band,
        dst_alpha=len(planes),
        resampling=Resampling.bilinear,
        warp_mem_limit=_WARP_MEMORY_MB,
        tolerance=_WARP_TOLERANCE_PX,
        XSCALE=scale_x,
        YSCALE=scale_y,
    )
    shown = [planes[band - 1] for band in bands]
    valid: BoolArray = planes[-1] > _HALF_COVERED
    for plane in shown:
        valid &= np.isfinite(plane)
    return np.stack(shown, axis=-1), valid


def _several_images(dataset: rasterio.DatasetReader, path: Path, what: str) -> str:
    """Return what to say of a container that GDAL opens without showing one image."""
    inside = dataset.subdatasets
    extract = f"; extract one: gdal_translate {inside[0]} OUT.tif" if inside else ""
    return f"{path}: the {what} is a container of {len(inside)} images, not an image{extract}"


def _georeference(dataset: rasterio.DatasetReader, path: Path, what: str) -> Georeference:
    crs, transform = dataset.crs, dataset.transform
    points, points_crs = dataset.gcps
    if transform.is_identity and points_crs is not None and len(points) >= 3:
        crs, transform = points_crs, from_gcps(points)
    if crs is None:
        raise MapWithoutCrsError(
            f"{path}: the {what} has no coordinate reference system; if you know it, write it into"
            f" the file: gdal_edit.py -a_srs EPSG:CODE {path}"
        )
    if transform.is_identity or transform.is_degenerate:
        raise MapWithoutCrsError(
            f"{path}: the {what} has no georeference (pixel to coordinates); give it one:"
            f" gdal_translate -a_srs EPSG:CODE -a_ullr WEST NORTH EAST SOUTH {path} OUT.tif"
        )
    place = Georeference(crs.to_wkt(), transform, dataset.width, dataset.height)
    try:
        sensible = _is_sensible(place)
    except ValueError as error:
        raise MapWithoutCrsError(
            f"{path}: the {what}'s CRS is not tied to the earth ({error})"
        ) from error
    if not sensible:
        raise MapWithoutCrsError(
            f"{path}: the {what}'s coordinates make no sense in its CRS; correct it:"
            f" gdal_edit.py -a_srs EPSG:CODE {path}"
        )
    return place


def _is_sensible(place: Georeference) -> bool:
    """Tell whether the map's middle lies on earth, with pixels of between 0.1 mm and 100 km."""
    middle = place.middle_deg()
    if not (np.isfinite(middle).all() and abs(middle[0]) <= 90.0):
        return False
    return _MIN_GSD_M < place.gsd_m(middle) < _MAX_GSD_M


def _choose_bands(interpretation: Sequence[ColorInterp]) -> tuple[tuple[int, ...], int]:
    """Return the bands to show as colour, and the alpha band or 0."""
    numbers = {kind: number for number, kind in reversed(list(enumerate(interpretation, start=1)))}
    alpha = numbers.get(ColorInterp.alpha, 0)
    named = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
    if all(kind in numbers for kind in named):
        return tuple(numbers[kind] for kind in named), alpha
    colours = [number for number in range(1, len(interpretation) + 1) if number != alpha]
    if len(colours) > 3:
        _log.info("map has %d bands of unnamed colours; showing the first three", len(colours))
    return tuple(colours[:3]) if len(colours) >= 3 else tuple(colours[:1]), alpha


def _palette_vrt(
    dataset: rasterio.DatasetReader, place: Georeference, path: Path, overview_level: int | None
) -> str:
    """Return a virtual raster (GDAL's VRT format) that shows a palette's colours and its mask."""
    root = ElementTree.Element(
        "VRTDataset", rasterXSize=str(dataset.width), rasterYSize=str(dataset.height)
    )
    ElementTree.SubElement(root, "SRS").text = place.crs_wkt
    ElementTree.SubElement(root, "GeoTransform").text = ",".join(
        repr(value) for value in place.transform.to_gdal()
    )
    palette_band = dataset.colorinterp.index(ColorInterp.palette) + 1
    for number, colour in enumerate(("Red", "Green", "Blue", "Alpha"), start=1):
        band = ElementTree.SubElement(root, "VRTRasterBand", dataType="Byte", band=str(number))
        ElementTree.SubElement(band, "ColorInterp").text = colour
        # a SimpleSource would do for the mask, but GDAL 3.10 warps it as if all were valid
        piece = ElementTree.SubElement(band, "ComplexSource")
        name = ElementTree.SubElement(piece, "SourceFilename", relativeToVRT="0")
        name.text = str(path.resolve())
        if overview_level is not None:
            options = ElementTree.SubElement(piece, "OpenOptions")
            ElementTree.SubElement(options, "OOI", key="OVERVIEW_LEVEL").text = str(overview_level)
        if colour == "Alpha":
            ElementTree.SubElement(piece, "SourceBand").text = f"mask,{palette_band}"
        else:
            ElementTree.SubElement(piece, "SourceBand").text = str(palette_band)
            ElementTree.SubElement(piece, "ColorTableComponent").text = str(number)
    return ElementTree.tostring(root, encoding="unicode")
