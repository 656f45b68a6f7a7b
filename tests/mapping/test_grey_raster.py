"""A grey map written in pieces."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import NDArray

from uasthn_cli.errors import OutputError
from uasthn_cli.mapping.georeference import Georeference
from uasthn_cli.mapping.grey_raster import write_grey_raster
from uasthn_cli.types import GridBox

PLACE = Georeference(
    rasterio.crs.CRS.from_epsg(32640).to_wkt(), Affine(2, 0, 5e5, 0, -2, 2.6e6), 70, 40
)


def pieces(image: NDArray[np.uint8]) -> Iterator[tuple[GridBox, NDArray[np.uint8]]]:
    """Yield an image in four pieces of different sizes."""
    for row, height in ((0, 25), (25, 15)):
        for column, width in ((0, 30), (30, 40)):
            box = GridBox(column, row, width, height)
            yield box, image[row : row + height, column : column + width]


def test_pieces_make_the_map(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (40, 70), dtype=np.uint8)
    write_grey_raster(tmp_path / "g.tif", PLACE, pieces(image))
    with rasterio.open(tmp_path / "g.tif") as source:
        assert (source.read(1) == image).all()
        assert (source.crs.to_epsg(), source.transform, source.nodata) == (
            32640,
            PLACE.transform,
            0,
        )
    assert len(list(tmp_path.iterdir())) == 1


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    image = np.zeros((40, 70), np.uint8)
    with pytest.raises(OutputError, match="cannot write"):
        write_grey_raster(tmp_path / "gone" / "g.tif", PLACE, pieces(image))
