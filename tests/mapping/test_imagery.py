"""Overhead images for training: any raster becomes 8-bit colour, what is unusable is skipped."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import NDArray
from PIL import Image
from rasterio.enums import ColorInterp

from uasthn_cli.mapping import imagery
from uasthn_cli.mapping.imagery import OverheadImage, read_overhead_tiles

NORTH_UP = Affine(0.5, 0, 420_000, 0, -0.5, 2_650_000)


def noise(height_px: int, width_px: int, bands: int = 3) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (height_px, width_px, bands), np.uint8)


def write_tif(path: Path, pixels: NDArray[Any], **profile: Any) -> Path:
    height_px, width_px, bands = pixels.shape
    shape = {"height": height_px, "width": width_px, "count": bands, "dtype": pixels.dtype}
    place = {"crs": "EPSG:32614", "transform": NORTH_UP}
    with rasterio.open(path, "w", driver="GTiff", **(shape | place | profile)) as target:
        target.write(np.moveaxis(pixels, -1, 0))
    return path


def read_one(path: Path) -> OverheadImage:
    (image,) = read_overhead_tiles(path)
    assert image.rgb.dtype == np.uint8
    return image


@pytest.mark.parametrize("name", ["photo.png", "photo.tif", "photo.bmp"])
def test_convention_colour_images_are_read_as_they_are(name: str, tmp_path: Path) -> None:
    pixels = noise(20, 30)
    Image.fromarray(pixels).save(tmp_path / name)
    image = read_one(tmp_path / name)
    assert np.array_equal(image.rgb, pixels)
    assert image.place is None


def test_jpeg(tmp_path: Path) -> None:
    Image.new("RGB", (30, 20), (200, 120, 40)).save(tmp_path / "photo.jpg")
    assert np.abs(read_one(tmp_path / "photo.jpg").rgb.astype(int) - (200, 120, 40)).max() <= 3


@pytest.mark.parametrize("mode", ["L", "LA"])
def test_grey_becomes_colour(mode: str, tmp_path: Path) -> None:
    grey = noise(20, 30, 1)[..., 0]
    Image.fromarray(grey).convert(mode).save(tmp_path / "grey.png")
    assert np.array_equal(read_one(tmp_path / "grey.png").rgb, np.dstack([grey] * 3))


def test_alpha_is_left_out(tmp_path: Path) -> None:
    pixels = noise(20, 30, 4)
    pixels[..., 3] = 255
    Image.fromarray(pixels).save(tmp_path / "photo.png")
    assert np.array_equal(read_one(tmp_path / "photo.png").rgb, pixels[..., :3])


def test_palettes_are_looked_up(tmp_path: Path) -> None:
    colours = np.array([[200, 10, 10], [10, 200, 10], [10, 10, 200]], np.uint8)
    index = np.random.default_rng(0).integers(0, 3, (20, 30))
    picture = Image.fromarray(index.astype(np.uint8), mode="P")
    picture.putpalette(colours.tobytes())
    picture.save(tmp_path / "drawn.png")
    assert np.array_equal(read_one(tmp_path / "drawn.png").rgb, colours[index])


def test_geotiffs_say_where_they_lie(tmp_path: Path) -> None:
    image = read_one(write_tif(tmp_path / "map.tif", noise(20, 30)))
    assert image.place == ("EPSG:32614", 420_000.0, 2_650_000.0, 0.5)


@pytest.mark.parametrize(
    "transform", [Affine.translation(9, 9) @ Affine.rotation(90), Affine(1, 0, 5, 0, 1, 5)]
)
def test_a_turned_raster_has_no_place_to_compare(transform: Affine, tmp_path: Path) -> None:
    path = write_tif(tmp_path / "map.tif", noise(20, 30), transform=transform)
    assert read_one(path).place is None


def test_16_bit_is_scaled_by_what_holds_data(tmp_path: Path) -> None:
    ramp = np.linspace(7_000, 9_000, 40 * 50).reshape(40, 50).astype(np.uint16)
    ramp[:10] = 0
    image = read_one(write_tif(tmp_path / "map.tif", ramp[..., None], nodata=0))
    assert (image.rgb[:10] == 0).all()
    held = image.rgb[10:, :, 0].astype(int).ravel()
    assert (np.diff(held) >= 0).all()
    assert held[0] == 0
    assert held[-1] == 255
    assert abs(held[len(held) // 2] - 127) <= 3


def test_numbers_that_are_none_become_black(tmp_path: Path) -> None:
    heights = np.random.default_rng(0).normal(size=(30, 40, 1)).astype(np.float32)
    heights[3:6, 4:9] = np.nan
    heights[20, 20] = np.inf
    image = read_one(write_tif(tmp_path / "heights.tif", heights))
    assert (image.rgb[3:6, 4:9] == 0).all()
    assert image.rgb[20, 20, 0] == 0
    assert image.rgb.std() > 30, "the others keep their contrast"


def test_large_images_come_in_tiles_with_their_own_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(imagery, "TILE_PX", 16)
    pixels = noise(20, 40)
    tiles = list(read_overhead_tiles(write_tif(tmp_path / "map.tif", pixels)))
    sizes = [tile.rgb.shape[:2] for tile in tiles]
    assert sizes == [(16, 16), (16, 16), (16, 8), (4, 16), (4, 16), (4, 8)]
    assert np.array_equal(tiles[4].rgb, pixels[16:, 16:32])
    assert tiles[4].place == ("EPSG:32614", 420_008.0, 2_649_992.0, 0.5)


def test_tiles_with_little_data_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(imagery, "TILE_PX", 20)
    pixels = np.maximum(noise(20, 40), 1)
    pixels[:, 8:28] = 0
    tiles = list(read_overhead_tiles(write_tif(tmp_path / "map.tif", pixels, nodata=0)))
    assert len(tiles) == 1
    assert np.array_equal(tiles[0].rgb, pixels[:, 20:])


def skipped(path: Path, caplog: pytest.LogCaptureFixture) -> str:
    """Return the one line that says that a file is skipped."""
    caplog.clear()
    with caplog.at_level(logging.WARNING, logger="uasthn_cli"):
        assert list(read_overhead_tiles(path)) == []
    (record,) = [r for r in caplog.records if r.name.startswith("uasthn_cli")]
    assert record.getMessage().startswith(f"{path}: skipped, not a readable image (")
    assert "\n" not in record.getMessage()
    return record.getMessage()


@pytest.mark.parametrize("content", [b"", b"not an image", b"\x89PNG\r\n\x1a\n broken"])
def test_what_is_no_image_is_skipped_with_a_line(
    content: bytes, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "photo.png"
    path.write_bytes(content)
    skipped(path, caplog)


def test_folders_truncated_files_and_missing_ones_are_skipped(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    skipped(tmp_path, caplog)
    skipped(tmp_path / "gone.tif", caplog)
    whole = write_tif(tmp_path / "map.tif", noise(64, 64)).read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[: len(whole) // 2])
    skipped(tmp_path / "cut.tif", caplog)


def test_complex_numbers_and_containers_are_skipped(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    radar = write_tif(tmp_path / "radar.tif", np.ones((20, 30, 1), np.complex64))
    assert "complex" in skipped(radar, caplog)
    several = tmp_path / "several.gpkg"
    for table in ("first", "second"):
        with rasterio.open(
            several,
            "w",
            driver="GPKG",
            dtype="uint8",
            crs="EPSG:32614",
            transform=NORTH_UP,
            RASTER_TABLE=table,
            APPEND_SUBDATASET="YES",
            width=30,
            height=20,
            count=3,
        ) as target:
            target.write(np.moveaxis(noise(20, 30), -1, 0))
    assert "container" in skipped(several, caplog)


def test_reading_leaves_no_file_behind(tmp_path: Path) -> None:
    path = write_tif(tmp_path / "map.tif", noise(20, 30), photometric="RGB")
    read_one(path)
    assert list(tmp_path.iterdir()) == [path]
    with rasterio.open(path) as source:
        assert source.colorinterp[0] == ColorInterp.red
