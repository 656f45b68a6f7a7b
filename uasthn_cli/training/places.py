"""Images of one place taken on several dates: the real change that training should see."""

from collections.abc import Iterator
from itertools import product

from uasthn_cli.mapping.imagery import OverheadImage

_SAME_PLACE_PX = 0.5
"""Grids further apart would teach the network that the ground moves."""

_Cell = tuple[str, float, int, int]


class Places:
    """Images gathered by place; iterates over places in the order they were first seen."""

    def __init__(self) -> None:
        """Start without any image."""
        self._all: list[list[OverheadImage]] = []
        self._by_cell: dict[_Cell, list[list[OverheadImage]]] = {}

    def __iter__(self) -> Iterator[list[OverheadImage]]:
        """Yield the images of each place."""
        return iter(self._all)

    def add(self, image: OverheadImage) -> None:
        """Add an image to the place where its grid agrees with the first image's, or to a new one.

        Grids agree if they have one CRS and resolution, and begin within half a pixel. An image
        that does not say where it lies is a place of its own.
        """
        dates = self._find(image)
        if dates is None:
            dates = []
            self._all.append(dates)
            if image.place is not None:
                self._by_cell.setdefault(_cell(image.place), []).append(dates)
        dates.append(image)

    def _find(self, image: OverheadImage) -> list[OverheadImage] | None:
        if image.place is None:
            return None
        crs, resolution, column, row = _cell(image.place)
        for i, j in product((0, -1, 1), repeat=2):
            for dates in self._by_cell.get((crs, resolution, column + i, row + j), []):
                if _begin_together(dates[0], image):
                    return dates
        return None


def _cell(place: tuple[str, float, float, float]) -> _Cell:
    crs, west, north, resolution = place
    return crs, round(resolution, 9), round(west / resolution), round(north / resolution)


def _begin_together(a: OverheadImage, b: OverheadImage) -> bool:
    if a.place is None or b.place is None:
        return False
    (_, west_a, north_a, resolution), (_, west_b, north_b, _) = a.place, b.place
    return max(abs(west_a - west_b), abs(north_a - north_b)) <= _SAME_PLACE_PX * resolution
