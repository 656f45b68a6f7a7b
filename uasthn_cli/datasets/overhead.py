"""Overhead images that windows can be read from: maps with a place on earth, plain pictures."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.datasets.windows import cut_square
from uasthn_cli.errors import DatasetError, MapWithoutCrsError
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m
from uasthn_cli.mapping.georeference import Georeference
from uasthn_cli.mapping.imagery import read_overhead_tiles
from uasthn_cli.mapping.raster import open_source
from uasthn_cli.mapping.reader import MapReader
from uasthn_cli.types import BoolArray, GridBox, ImageArray

_SAME_PLACE_M = 100.0
"""Maps whose middles lie closer than this are taken as dates of one place."""


class Site(Protocol):
    """A place of which one or several images exist, on one grid of pixels."""

    @property
    def area_m2(self) -> float:
        """Ground area, by which places are drawn."""

    @property
    def dates(self) -> int:
        """Number of images of the place."""

    @property
    def gsd_m(self) -> float:
        """Metres a pixel of the grid."""

    @property
    def extent(self) -> GridBox:
        """The grid pixels that the place covers."""

    def read(self, date: int, box: GridBox) -> tuple[ImageArray, BoolArray]:
        """Return colours ``(h, w, 3)`` in 0..1 and which are known ``(h, w)``."""


class MapSite:
    """GeoTIFFs of one place, read window by window on a common north-up grid."""

    def __init__(
        self, paths: Sequence[Path], place: Georeference, native_m: float, gsd_m: float
    ) -> None:
        """Take maps of the same area; ``place`` and ``native_m`` are the first one's."""
        self._paths, self._gsd_m = tuple(paths), gsd_m
        middle = place.middle_deg()
        self._frame = LocalFrame(float(middle[0]), float(middle[1]))
        reach_m = np.array([place.width_px, place.height_px]) * native_m / 2.0
        self._half_px = np.maximum((reach_m / gsd_m).astype(int), 1)

    def __getstate__(self) -> dict[str, Any]:
        """Leave open files behind: another process opens its own."""
        return {name: value for name, value in self.__dict__.items() if name != "_readers"}

    @property
    def area_m2(self) -> float:
        """Ground area."""
        return float(np.prod(2.0 * self._half_px * self._gsd_m))

    @property
    def dates(self) -> int:
        """Number of maps."""
        return len(self._paths)

    @property
    def gsd_m(self) -> float:
        """Metres a pixel."""
        return self._gsd_m

    @property
    def extent(self) -> GridBox:
        """The first map's box, if it is upright; its bounding square's middle part otherwise."""
        half_x, half_y = (int(half) for half in self._half_px)
        return GridBox(-half_x, -half_y, 2 * half_x, 2 * half_y)

    def read(self, date: int, box: GridBox) -> tuple[ImageArray, BoolArray]:
        """Return a window of one date."""
        window = self._readers[date].read(box)
        return window.image, window.valid

    @cached_property
    def _readers(self) -> list[MapReader]:
        return [MapReader(path, self._frame, self._gsd_m) for path in self._paths]


class PictureSite:
    """A plain picture whose metres a pixel the user tells."""

    dates = 1

    def __init__(self, rgb: NDArray[np.uint8], gsd_m: float) -> None:
        """Keep the picture ``(h, w, 3)``."""
        self._rgb, self._gsd_m = rgb, gsd_m

    @property
    def area_m2(self) -> float:
        """Ground area."""
        return float(self._rgb.shape[0] * self._rgb.shape[1] * self._gsd_m**2)

    @property
    def gsd_m(self) -> float:
        """Metres a pixel."""
        return self._gsd_m

    @property
    def extent(self) -> GridBox:
        """All of the picture."""
        return GridBox(0, 0, self._rgb.shape[1], self._rgb.shape[0])

    def read(self, date: int, box: GridBox) -> tuple[ImageArray, BoolArray]:
        """Return a square window; there is only one date."""
        first_px = (box.column_px, box.row_px)
        piece = cut_square(self._rgb, first_px, box.width_px)
        known = cut_square(np.ones(self._rgb.shape[:2], np.bool_), first_px, box.width_px)
        return piece.astype(np.float32) / np.float32(255.0), known


def open_sites(paths: Sequence[Path], gsd_m: float | None) -> list[Site]:
    """Return the places that image files show; maps of one place are its dates.

    ``gsd_m`` None reads maps at their own resolution; pictures without a place need it.

    Raises:
        DatasetError: a picture does not say where it lies and no GSD is given.
        MapUnreadableError: a file is no image.
    """
    sites: list[Site] = []
    groups: list[tuple[Georeference, float, list[Path]]] = []
    for path in paths:
        try:
            source = open_source(path)
        except MapWithoutCrsError as error:
            if gsd_m is None:
                raise DatasetError(
                    f"{path} does not say where it lies: give its metres a pixel by --gsd"
                ) from error
            sites += [PictureSite(tile.rgb, gsd_m) for tile in read_overhead_tiles(path)]
            continue
        source.dataset.close()
        for place, _, dates in groups:
            if _is_same_place(place, source.place):
                dates.append(path)
                break
        else:
            middle = source.place.middle_deg()
            groups.append((source.place, source.place.gsd_m(middle), [path]))
    maps = [MapSite(dates, place, native, gsd_m or native) for place, native, dates in groups]
    return [*maps, *sites]


def _is_same_place(a: Georeference, b: Georeference) -> bool:
    """Tell whether two maps are about the same ground."""
    same_size = max(abs(a.width_px - b.width_px), abs(a.height_px - b.height_px)) <= 2
    return same_size and float(distance_m(a.middle_deg(), b.middle_deg())) <= _SAME_PLACE_M
