"""Boson-nighttime in the layout its authors publish (README of the UASTHN repository, 2025).

::

    datasets/
      maps/satellite/20201117_BingSatellite.png     1 m a pixel, north-up
      satellite_0_thermalmapping_135/               the folder to name
        train_queries.h5  val_queries.h5  test_queries.h5  [extended_queries.h5]

A ``*_queries.h5`` holds ``image_data`` ``(n, 768, 768[, channels])`` 8-bit thermal images at 1 m a
pixel, ``image_size`` ``(n, 2)`` (height, width: what of ``image_data`` is image) and
``image_name`` ``(n,)``, text with the image's centre as ``@first@second@`` in metres. The middle
512 px are used. ``*_database.h5`` is not read: satellite windows are cut from the map. The map lies
in ``maps/satellite`` of the folder or of the one around it; several PNGs of one size count as dates
of the place. A world file beside it (``.pgw``) says where it lies; without one, the names' metres
count from the map's upper left edge, (column, row) where all of them fit so, else (row, column).
"""

import logging
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.datasets.windows import (
    cut_square,
    draw_offset_m,
    evenly,
    image_u8,
    sample_rng,
    square_corners_px,
)
from uasthn_cli.errors import DatasetError, MissingExtraError
from uasthn_cli.types import BoolArray, FloatArray

try:
    import h5py
except ModuleNotFoundError as error:
    raise MissingExtraError(
        "Boson-nighttime is read by h5py, which is not installed: pip install 'uasthn[datasets]'"
    ) from error

THERMAL_PX: Final = 512
GSD_M: Final = 1.0

_log = logging.getLogger(__name__)

_NUMBER: Final = r"(-?\d+(?:\.\d+)?)"
_PLACE: Final = re.compile(rf"@{_NUMBER}@{_NUMBER}@")
_PNG_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_KEYS: Final = ("image_data", "image_name", "image_size")


class BosonDataset:
    """One split of Boson-nighttime, read image by image when asked for."""

    def __init__(self, folder: Path, spec: DatasetSpec) -> None:
        """Read the names of a split, and check what will be read later.

        Raises:
            DatasetError: a file is missing, damaged or of another layout.
        """
        self._path, self._spec = folder / f"{spec.split}_queries.h5", spec
        self._maps = _find_maps(folder)
        self._names = _read_names(self._path)
        places = _places(self._names, self._path)
        size_px = _map_size_px(self._maps)
        self._world = _read_world(self._maps[0])
        swapped = self._world is None and not _on_map(places, size_px).all()
        if swapped:
            places = places[:, ::-1]
            _log.info("%s: names hold (row, column) of the map", self._path)
        self._swapped = swapped
        self._centres_px = self._to_pixels(places)
        if not _on_map(self._centres_px, size_px).any():
            raise DatasetError(
                f"{self._path}: no image lies on {self._maps[0].name}"
                f" ({size_px[0]} × {size_px[1]} px): is it the map of this data set?"
            )
        self._indices = np.flatnonzero(self._kept(folder))
        if spec.samples is not None:
            self._indices = evenly(self._indices, spec.samples)

    def __getstate__(self) -> dict[str, Any]:
        """Leave the open file and the maps behind: another process reads its own."""
        left = {"_images", "_pixels"}
        return {name: value for name, value in self.__dict__.items() if name not in left}

    def __len__(self) -> int:
        """Return the number of images used."""
        return len(self._indices)

    def __getitem__(self, index: int) -> MatchSample:
        """Return an image and the map around a place within D_C of it.

        Raises:
            IndexError: there are not so many.
            DatasetError: the file or the map cannot be read.
        """
        if not 0 <= index < len(self):
            raise IndexError(index)
        row = int(self._indices[index])
        rng = sample_rng(self._spec.seed, row, self._spec.split)
        side_px = round(self._spec.satellite_m / GSD_M)
        offset_px = draw_offset_m(rng, self._spec.largest_offset_m) / GSD_M
        first_px = np.round(self._centres_px[row] + offset_px - (side_px - 1) / 2).astype(int)
        satellite = cut_square(
            self._map(int(rng.integers(len(self._maps)))),
            (int(first_px[0]), int(first_px[1])),
            side_px,
        )
        corners_px = square_corners_px(THERMAL_PX, self._centres_px[row]) - first_px
        return MatchSample(self._names[row], satellite, self._thermal(row), corners_px, GSD_M)

    def _to_pixels(self, places: FloatArray) -> FloatArray:
        """Return map pixels ``(n, 2)`` of places in the names' metres."""
        if self._world is None:
            return places - 0.5  # metres from the map's edge, where its first pixel begins
        return _apply_inverse(self._world, places)

    def _kept(self, folder: Path) -> BoolArray:
        """Return which images are used: all, or those that see nothing of the validation region."""
        kept = np.ones(len(self._names), np.bool_)
        if not self._spec.exclude_validation or self._spec.split == "val":
            return kept
        path = folder / "val_queries.h5"
        places = _places(_read_names(path), path)
        centres_px = self._to_pixels(places[:, ::-1] if self._swapped else places)
        reach_px = THERMAL_PX / GSD_M
        first, last = centres_px.min(axis=0) - reach_px, centres_px.max(axis=0) + reach_px
        inside = ((self._centres_px > first) & (self._centres_px < last)).all(axis=1)
        _log.info("%s: %d images see the validation region", self._path, int(inside.sum()))
        return np.asarray(kept & ~inside)

    def _thermal(self, row: int) -> NDArray[np.uint8]:
        """Return the middle 512 px of an image as grey."""
        if not hasattr(self, "_images"):
            self._images = _open(self._path)
        height_px, width_px = (int(side) for side in self._images["image_size"][row][:2])
        pixels = np.asarray(self._images["image_data"][row])[:height_px, :width_px]
        if min(height_px, width_px) < THERMAL_PX:
            raise DatasetError(
                f"{self._path}: image {row} is {width_px} × {height_px} px, {THERMAL_PX} are used"
            )
        if pixels.ndim == 3:
            pixels = pixels.mean(axis=2).round().astype(pixels.dtype)
        first_px = ((width_px - THERMAL_PX) // 2, (height_px - THERMAL_PX) // 2)
        return image_u8(cut_square(pixels, first_px, THERMAL_PX))

    def _map(self, date: int) -> NDArray[np.uint8]:
        """Return a map ``(h, w, 3)``, decoded once: a PNG cannot be read in pieces."""
        if not hasattr(self, "_pixels"):
            self._pixels: dict[int, NDArray[np.uint8]] = {}
        if date not in self._pixels:
            image = cv2.imread(str(self._maps[date]), cv2.IMREAD_COLOR_RGB)
            if image is None:
                raise DatasetError(f"{self._maps[date]} cannot be read: is it a whole PNG?")
            self._pixels[date] = np.asarray(image, np.uint8)
        return self._pixels[date]


def _find_maps(folder: Path) -> list[Path]:
    for place in (folder, folder.parent, folder.resolve().parent):
        maps = sorted((place / "maps" / "satellite").glob("*.png"))
        if maps:
            return maps
    raise DatasetError(
        f"{folder}: no satellite map: put it at {folder.parent / 'maps' / 'satellite'}/*.png"
    )


def _map_size_px(maps: Sequence[Path]) -> tuple[int, int]:
    """Return the maps' common ``(width, height)``, from their headers: decoding takes seconds."""
    sizes = set()
    for path in maps:
        with path.open("rb") as handle:
            head = handle.read(24)
        if len(head) < 24 or not head.startswith(_PNG_SIGNATURE):
            raise DatasetError(f"{path} is no PNG")
        width_px, height_px = struct.unpack(">II", head[16:24])
        sizes.add((int(width_px), int(height_px)))
    if len(sizes) > 1:
        raise DatasetError(f"{maps[0].parent}: maps differ in size: leave those of one place there")
    return sizes.pop()


def _open(path: Path) -> Any:
    if not path.exists():
        raise DatasetError(f"{path} does not exist: choose another --split, or complete the folder")
    try:
        opened = h5py.File(path, "r")
    except OSError as error:
        raise DatasetError(f"{path} is no whole HDF5 file") from error
    missing = [key for key in _KEYS if key not in opened]
    if missing:
        raise DatasetError(f"{path} has no {', '.join(missing)}: is it of Boson-nighttime?")
    return opened


def _read_names(path: Path) -> list[str]:
    with _open(path) as opened:
        names = opened["image_name"][()]
        if len(names) == 0 or len(names) != len(opened["image_data"]):
            raise DatasetError(f"{path}: {len(names)} names for {len(opened['image_data'])} images")
    return [name.decode() if isinstance(name, bytes) else str(name) for name in names.ravel()]


def _places(names: Sequence[str], path: Path) -> FloatArray:
    """Return the two numbers in each name ``(n, 2)``."""
    found = [_PLACE.search(name) for name in names]
    unknown = [name for name, match in zip(names, found, strict=True) if match is None]
    if unknown:
        raise DatasetError(f"{path}: the name {unknown[0]!r} holds no @easting@northing@")
    return np.array([(float(match[1]), float(match[2])) for match in found if match is not None])


def _on_map(points_px: FloatArray, size_px: tuple[int, int]) -> BoolArray:
    return np.asarray(((points_px >= 0) & (points_px < np.array(size_px))).all(axis=1))


def _read_world(map_path: Path) -> FloatArray | None:
    """Return the affine map ``(2, 3)`` of a world file from pixel centres to metres, if any."""
    path = map_path.with_suffix(".pgw")
    if not path.exists():
        return None
    try:
        a, d, b, e, c, f = (float(line) for line in path.read_text("utf-8").split())
    except ValueError as error:
        raise DatasetError(f"{path} is no world file: six numbers are expected") from error
    if not np.isclose([a, -e, b, d], [GSD_M, GSD_M, 0, 0]).all():
        raise DatasetError(f"{path}: the map must be north-up at {GSD_M:g} m a pixel")
    return np.array([[a, b, c], [d, e, f]])


def _apply_inverse(world: FloatArray, places: FloatArray) -> FloatArray:
    return np.asarray((places - world[:, 2]) @ np.linalg.inv(world[:, :2]).T)
