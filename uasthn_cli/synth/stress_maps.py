"""Maps made worse: cut off, out of date, of another place, or one pattern throughout."""

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rasterio import windows

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.mapping.georeference import Georeference
from uasthn_cli.mapping.raster import gdal_errors, open_source
from uasthn_cli.synth.kinds import LandscapeKind
from uasthn_cli.synth.landscape import render_landscape
from uasthn_cli.synth.map_raster import write_tiles
from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.synth.repetition import Repetition
from uasthn_cli.types import FloatArray

Bands = NDArray[np.uint8]

_LEAST_MAP_PX = 16
_MOST_RENDERED_PIXELS = 12_000_000
_LEAST_CONTRAST = 12.0
_PATTERN_NOISE = 0.15


@dataclass(frozen=True, slots=True)
class MapImage:
    """Colours ``(3, h, w)`` of a map and where it lies."""

    bands: Bands
    place: Georeference

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.place.height_px, self.place.width_px

    @property
    def pixel_m(self) -> FloatArray:
        """Metres on the ground ``(2,)`` per step in x and in y, at the middle of the map."""
        steps_m = self.place.metres_per_pixel(self.place.middle_deg())
        return np.asarray(np.linalg.norm(steps_m, axis=0))


def read_map(path: Path) -> MapImage:
    """Read the colours of a GeoTIFF whole.

    Raises:
        MapUnreadableError: missing, corrupt, or not a raster that GDAL reads.
        MapWithoutCrsError: it does not say where on earth it lies.
        SyntheticFlightError: its values are not bytes.
    """
    source = open_source(path)
    with source.dataset as dataset, gdal_errors(path, "read"):
        bands = dataset.read(list(source.colour_bands))
    if bands.dtype != np.uint8:
        raise SyntheticFlightError(f"{path}: the map has {bands.dtype} values, 8 bits are needed")
    return MapImage(np.broadcast_to(bands, (3, *bands.shape[1:])), source.place)


def write_changed_map(path: Path, image: MapImage) -> None:
    """Write a map without loss.

    Raises:
        OutputError: the file cannot be written.
    """
    write_tiles(path, image.bands, image.place.transform, image.place.crs_wkt, jpeg=False)


def of_another_place(
    image: MapImage, rng: np.random.Generator, donors: tuple[Path, ...] = ()
) -> MapImage:
    """Return a map that shows another place on the same ground and grid.

    The place is a random piece, perhaps mirrored, of one of the donors at the true scale (repeated
    in mirror images where a donor is too small), or a rendered landscape.
    """
    if not donors:
        return MapImage(_rendered(image, rng), image.place)
    donor = read_map(donors[int(rng.integers(len(donors)))])
    return MapImage(_piece_of(donor, image, rng), image.place)


def outdated(
    image: MapImage,
    severity: float,
    rng: np.random.Generator,
    *,
    patch_m: float,
    donors: tuple[Path, ...] = (),
) -> MapImage:
    """Return a map on which a share ``severity`` of the ground shows other land cover.

    It changes in ragged patches, the largest some ``patch_m`` across.
    """
    gsd_m = float(np.sqrt(image.pixel_m.prod()))
    noise = fractal_noise(rng, image.shape, gsd_m, max(patch_m, 2.0 * gsd_m))
    changed = noise <= np.quantile(noise, severity)
    other = of_another_place(image, rng, donors)
    return MapImage(np.where(changed, other.bands, image.bands), image.place)


def cut_off(
    image: MapImage, seen_px: FloatArray, severity: float, rng: np.random.Generator
) -> tuple[MapImage, FloatArray]:
    """Cut a map along a straight edge, so that a share ``severity`` of what is seen is beyond it.

    ``seen_px`` ``(frames, n, 2)`` samples the frames' footprints in map pixels. The second result
    ``(frames,)`` is the share of each footprint that is left on the map.

    Raises:
        SyntheticFlightError: no side of the map has ground left.
    """
    size_px = np.array([image.place.width_px, image.place.height_px])
    for side in rng.permutation(4):
        axis, from_start = divmod(int(side), 2)
        along = seen_px[..., axis]
        first_px, last_px = np.zeros(2, dtype=int), size_px.copy()
        if from_start:
            first_px[axis] = max(0, math.ceil(np.quantile(along, severity) + 0.5))
        else:
            last_px[axis] = min(size_px[axis], math.floor(np.quantile(along, 1 - severity) + 0.5))
        if last_px[axis] - first_px[axis] >= _LEAST_MAP_PX:
            on_map = ((seen_px > first_px - 0.5) & (seen_px < last_px - 0.5)).all(axis=-1)
            return _cropped(image, first_px, last_px), on_map.mean(axis=-1)
    raise SyntheticFlightError(
        f"no side of the map has {_LEAST_MAP_PX} px left beyond {severity:.0%} of what the frames"
        " see: take a lower severity or a larger map"
    )


def repeated(
    image: MapImage, repetition: Repetition, severity: float, rng: np.random.Generator
) -> MapImage:
    """Return a map of which a share ``severity`` of the contrast is one pattern repeated.

    Mean and contrast of each colour stay; a little grain of its own keeps the map from being flat.
    """
    rows, columns = np.indices(image.shape)
    points_m = np.stack([columns, rows], axis=-1) * image.pixel_m
    pattern = repetition.day(points_m)
    pattern += _PATTERN_NOISE * rng.standard_normal(image.shape, dtype=np.float32)
    mean = image.bands.mean(axis=(1, 2), keepdims=True)
    contrast = np.maximum(image.bands.std(axis=(1, 2), keepdims=True), _LEAST_CONTRAST)
    mixed = (1.0 - severity) * image.bands + severity * (mean + contrast * pattern)
    return MapImage(np.clip(np.rint(mixed), 0, 255).astype(np.uint8), image.place)


def _cropped(image: MapImage, first_px: NDArray[np.int_], last_px: NDArray[np.int_]) -> MapImage:
    """Return the pixels from ``first_px`` up to ``last_px`` (x, y), which are where they were."""
    (x0, y0), (x1, y1) = first_px, last_px
    window = windows.Window(int(x0), int(y0), int(x1 - x0), int(y1 - y0))
    place = Georeference(
        image.place.crs_wkt,
        windows.transform(window, image.place.transform),
        window.width,
        window.height,
    )
    return MapImage(image.bands[:, y0:y1, x0:x1], place)


def _rendered(image: MapImage, rng: np.random.Generator) -> Bands:
    """Render a landscape of any kind onto a map's grid."""
    height_px, width_px = image.shape
    extent_m = image.pixel_m * (width_px, height_px)
    gsd_m = max(float(image.pixel_m.min()), math.sqrt(extent_m.prod() / _MOST_RENDERED_PIXELS))
    width, height = (max(16, round(side_m / gsd_m)) for side_m in extent_m)
    kind = list(LandscapeKind)[int(rng.integers(len(LandscapeKind)))]
    place = render_landscape(int(rng.integers(2**31)), (width, height), gsd_m, kind=kind)
    resized = cv2.resize(place.rgb, (width_px, height_px), interpolation=cv2.INTER_AREA)
    return np.asarray(resized.transpose(2, 0, 1), dtype=np.uint8)


def _piece_of(donor: MapImage, image: MapImage, rng: np.random.Generator) -> Bands:
    """Resample a random piece of a donor to a map's grid at the same scale."""
    height_px, width_px = image.shape
    scale = image.pixel_m / donor.pixel_m
    room_px = np.array([donor.place.width_px, donor.place.height_px]) - scale * (
        width_px,
        height_px,
    )
    x0, y0 = rng.uniform(0.0, 1.0, 2) * np.maximum(room_px, 0.0)
    finer = math.sqrt(max(0.0, float(scale.prod()) - 1.0))
    colours = smooth(donor.bands.transpose(1, 2, 0).astype(np.float32), 0.5 * finer)
    piece = cv2.warpAffine(
        colours,
        np.array([[scale[0], 0.0, x0], [0.0, scale[1], y0]]),
        (width_px, height_px),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REFLECT,
    )
    mirrors = tuple(1 - 2 * int(flip) for flip in rng.integers(0, 2, 2))
    shown = np.clip(np.rint(piece), 0, 255)[:: mirrors[0], :: mirrors[1]]
    return np.ascontiguousarray(shown.transpose(2, 0, 1), dtype=np.uint8)
