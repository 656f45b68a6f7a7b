"""A map read piece by piece in its own pixels, whatever its values."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rasterio.enums import ColorInterp

from uasthn_cli.errors import MapUnreadableError
from uasthn_cli.mapping.colour_raster import ColourRaster
from uasthn_cli.types import GridBox

WriteMap = Callable[..., Path]
BOX = GridBox(11, 5, 30, 20)


@pytest.fixture
def pixels() -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(1, 256, (60, 90, 3), dtype=np.uint8)


def cut(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return pixels[5:25, 11:41]


def test_pixels_come_as_they_are(write_map: WriteMap, pixels: NDArray[np.uint8]) -> None:
    with ColourRaster(write_map(pixels)) as raster:
        assert (raster.place.width_px, raster.place.height_px) == (90, 60)
        assert raster.gsd_m() == pytest.approx(2.0, rel=1e-3)
        assert (raster.read(BOX, (30, 20)) == cut(pixels)).all()
        assert raster.valid(BOX).all()


def test_a_smaller_size_is_averaged(write_map: WriteMap, pixels: NDArray[np.uint8]) -> None:
    with ColourRaster(write_map(pixels)) as raster:
        half = raster.read(BOX, (15, 10)).astype(float)
    expected = cut(pixels).reshape(10, 2, 15, 2, 3).mean(axis=(1, 3))
    assert np.abs(half - expected).max() <= 1


def test_grey_becomes_colour(write_map: WriteMap, pixels: NDArray[np.uint8]) -> None:
    with ColourRaster(write_map(pixels[..., 0])) as raster:
        assert (raster.read(BOX, (30, 20)) == cut(pixels)[..., :1]).all()


def test_16_bits_are_scaled_the_same_throughout(
    write_map: WriteMap, pixels: NDArray[np.uint8]
) -> None:
    with ColourRaster(write_map(pixels.astype(np.uint16) * 17 + 300)) as raster:
        read = raster.read(BOX, (30, 20)).astype(int)
        alone = raster.read(GridBox(11, 5, 1, 1), (1, 1)).astype(int)
    assert (alone[0, 0] == read[0, 0]).all()
    assert np.abs(read - cut(pixels)).max() < 8


def test_no_data_is_black_and_not_valid(write_map: WriteMap, pixels: NDArray[np.uint8]) -> None:
    mask = np.ones((60, 90), np.bool_)
    mask[:10] = False
    with ColourRaster(write_map(pixels, mask=mask)) as raster:
        assert (raster.valid(BOX) == mask[5:25, 11:41]).all()
        read = raster.read(BOX, (30, 20))
    assert (read[:5] == 0).all()
    assert (read[5:] == cut(pixels)[5:]).all()


def test_alpha_is_no_colour(write_map: WriteMap, pixels: NDArray[np.uint8]) -> None:
    alpha = np.full((60, 90, 1), 255, np.uint8)
    alpha[:, :20] = 0
    kinds = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
    path = write_map(np.concatenate([pixels, alpha], axis=-1), interpretation=kinds)
    with ColourRaster(path) as raster:
        assert (raster.valid(BOX) == (alpha[5:25, 11:41, 0] > 0)).all()
        assert (raster.read(BOX, (30, 20))[:, 9:] == cut(pixels)[:, 9:]).all()


def test_a_map_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(MapUnreadableError, match="no such map"):
        ColourRaster(tmp_path / "gone.tif")
