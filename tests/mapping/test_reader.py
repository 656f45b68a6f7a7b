"""Windows land where the conventions say, whatever the map's bands, bits, CRS and holes."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import NDArray
from rasterio.control import GroundControlPoint
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning

from uasthn_cli.geometry.geodesy import LocalFrame, from_crs, to_crs
from uasthn_cli.geometry.pixels import metres_to_grid
from uasthn_cli.mapping.raster import fitting_overview
from uasthn_cli.mapping.reader import MapReader, native_gsd_m
from uasthn_cli.pipeline.parallel import in_order
from uasthn_cli.types import FloatArray, GridBox, MapWindow

RED, GREEN, BLUE = ColorInterp.red, ColorInterp.green, ColorInterp.blue
GREY, ALPHA, UNDEFINED = ColorInterp.gray, ColorInterp.alpha, ColorInterp.undefined
WHOLE = GridBox(-20, -10, 40, 24)
"""The box of a 40 × 24 map written with the default transform."""


def noise(*shape: int, dtype: str = "uint8", high: int = 255) -> NDArray[Any]:
    return np.random.default_rng(1).integers(1, high, shape).astype(dtype)


def read(path: Path, frame: LocalFrame, box: GridBox, gsd_m: float = 2.0) -> MapWindow:
    with MapReader(path, frame, gsd_m) as reader:
        return reader.read(box)


def blob(width_px: int, height_px: int, x: float, y: float, sigma_px: float = 3.0) -> FloatArray:
    column, row = np.meshgrid(np.arange(width_px), np.arange(height_px))
    squared = ((column - x) ** 2 + (row - y) ** 2) / sigma_px**2
    return np.asarray(250 * np.exp(-squared / 2), dtype=np.float64)


def centroid(window: MapWindow) -> FloatArray:
    weight = window.image[..., 0].astype(np.float64)
    rows, columns = np.indices(weight.shape)
    x, y = (weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()
    return np.array([x + window.box.column_px, y + window.box.row_px])


def test_convention_a_map_on_the_grid_is_read_back_pixel_by_pixel(
    write_map: Any, frame: LocalFrame
) -> None:
    pixels = noise(24, 40, 3)
    window = read(write_map(pixels), frame, WHOLE)
    assert window.image.shape == (24, 40, 3)
    np.testing.assert_allclose(window.image, pixels / 255, atol=1e-6)
    assert window.valid.all()
    part = read(write_map(pixels), frame, GridBox(-13, -4, 5, 3))
    np.testing.assert_allclose(part.image, pixels[6:9, 7:12] / 255, atol=1e-6)


@pytest.mark.parametrize("crs", ["EPSG:32614", "EPSG:4326", "EPSG:3857"])
def test_convention_a_mark_on_the_map_appears_at_its_place_on_the_grid(
    write_map: Any, frame: LocalFrame, crs: str
) -> None:
    step = {"EPSG:4326": (2.6e-5, 1.8e-5), "EPSG:3857": (2.9, 2.9)}.get(crs, (2.0, 2.0))
    x0, y0 = to_crs(crs, np.array([frame.lat_deg, frame.lon_deg])) + (-150, 90) * np.array(step)
    transform = Affine(step[0], 0.0, x0, 0.0, -step[1], y0)
    mark_px = (170.0, 60.0)
    path = write_map(blob(300, 200, *mark_px).astype(np.uint8), crs=crs, transform=transform)
    mark = np.array(transform @ (mark_px[0] + 0.5, mark_px[1] + 0.5))
    expected = metres_to_grid(
        MapReader(path, frame, 2.0).grid, frame.to_metres(from_crs(crs, mark))
    )
    column, row = (int(value) for value in np.floor(expected) - (30, 20))
    box = GridBox(column, row, 60, 40)
    np.testing.assert_allclose(centroid(read(path, frame, box)), expected, atol=0.05)


def test_convention_south_up_and_rotated_maps_are_turned_north_up(
    write_map: Any, frame: LocalFrame
) -> None:
    pixels = noise(24, 40, 3)
    north_up = read(write_map(pixels), frame, WHOLE).image
    t = Affine(2.0, 0.0, -41.0, 0.0, -2.0, 21.0)
    flipped = write_map(pixels[::-1], "flipped.tif", transform=t @ Affine(1, 0, 0, 0, -1, 24))
    np.testing.assert_allclose(read(flipped, frame, WHOLE).image, north_up, atol=1e-4)
    turned_pixels = np.ascontiguousarray(np.rot90(pixels))
    turned = write_map(turned_pixels, "turned.tif", transform=t @ Affine(0, -1, 40, 1, 0, 0))
    np.testing.assert_allclose(read(turned, frame, WHOLE).image, north_up, atol=1e-4)


def test_what_lies_outside_the_map_is_zero_and_not_valid(write_map: Any, frame: LocalFrame) -> None:
    pixels = noise(24, 40, 3)
    path = write_map(pixels)
    window = read(path, frame, GridBox(-25, -13, 60, 50))
    expected = np.zeros((50, 60), dtype=bool)
    expected[3:27, 5:45] = True
    np.testing.assert_array_equal(window.valid, expected)
    assert not window.image[~window.valid].any()
    with MapReader(path, frame, 2.0) as reader:
        assert reader.valid_fraction(GridBox(-25, -13, 60, 50)) == pytest.approx(960 / 3000)
        assert reader.valid_fraction(GridBox(10_000, 0, 8, 8)) == 0.0


@pytest.mark.parametrize(
    ("count", "interpretation", "shown"),
    [
        (1, (GREY,), (0, 0, 0)),
        (3, (RED, GREEN, BLUE), (0, 1, 2)),
        (3, (BLUE, GREEN, RED), (2, 1, 0)),
        (4, (RED, GREEN, BLUE, UNDEFINED), (0, 1, 2)),
        (4, (GREY, UNDEFINED, UNDEFINED, UNDEFINED), (0, 1, 2)),
        (2, (GREY, UNDEFINED), (0, 0, 0)),
        (5, (UNDEFINED, BLUE, GREEN, RED, UNDEFINED), (3, 2, 1)),
        (6, (GREY, *[UNDEFINED] * 5), (0, 1, 2)),
    ],
)
def test_bands_are_chosen_by_their_colour(
    write_map: Any, frame: LocalFrame, count: int, interpretation: Any, shown: tuple[int, ...]
) -> None:
    pixels = noise(24, 40, count)
    window = read(write_map(pixels, interpretation=interpretation), frame, WHOLE)
    np.testing.assert_allclose(window.image, pixels[..., list(shown)] / 255, atol=1e-6)
    assert window.valid.all()


def hole() -> NDArray[np.bool_]:
    """Return which pixels of a 40 × 24 map have data."""
    has_data = np.ones((24, 40), dtype=np.bool_)
    has_data[5:9, 11:20] = False
    return has_data


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("colours", [1, 3])
def test_alpha_says_what_is_valid(
    write_map: Any, frame: LocalFrame, colours: int, dtype: str
) -> None:
    opaque = np.iinfo(dtype).max
    alpha = np.where(hole(), opaque, 0).astype(dtype)[..., None]
    pixels = np.concatenate([noise(24, 40, colours, dtype=dtype), alpha], axis=-1)
    kinds = (GREY, ALPHA) if colours == 1 else (RED, GREEN, BLUE, ALPHA)
    window = read(write_map(pixels, interpretation=kinds), frame, WHOLE)
    np.testing.assert_array_equal(window.valid, hole())
    assert not window.image[~hole()].any()
    assert window.image[hole()].min(axis=-1).max() > 0


def test_nodata_is_a_hole_only_where_every_band_has_it(write_map: Any, frame: LocalFrame) -> None:
    pixels = np.where(hole()[..., None], noise(24, 40, 3), 0).astype(np.uint8)
    pixels[20, :, 0] = 0
    window = read(write_map(pixels, nodata=0), frame, WHOLE)
    np.testing.assert_array_equal(window.valid, hole())
    np.testing.assert_allclose(window.image, pixels / 255, atol=1e-6)


def test_mask_flags_say_what_is_valid(write_map: Any, frame: LocalFrame) -> None:
    window = read(write_map(noise(24, 40, 3), mask=hole()), frame, WHOLE)
    np.testing.assert_array_equal(window.valid, hole())


@pytest.mark.parametrize("nodata", [None, float("nan")])
def test_values_that_are_not_numbers_are_holes(
    write_map: Any, frame: LocalFrame, nodata: float | None
) -> None:
    pixels = np.where(hole(), noise(24, 40), np.nan).astype(np.float32)
    window = read(write_map(pixels, nodata=nodata), frame, WHOLE)
    np.testing.assert_array_equal(window.valid, hole())
    assert np.isfinite(window.image).all()


@pytest.mark.parametrize("dtype", ["uint16", "int16", "float32"])
def test_more_than_eight_bits_are_stretched_between_robust_percentiles(
    write_map: Any, frame: LocalFrame, dtype: str
) -> None:
    pixels = noise(24, 40, 3, dtype="float64", high=4000) + 500
    pixels[0, 0], pixels[1, 1] = 32000, 0
    window = read(write_map(pixels.astype(dtype)), frame, WHOLE)
    low, high = np.percentile(pixels, (1, 99))
    expected = np.clip((pixels - low) / (high - low), 0, 1)
    np.testing.assert_allclose(window.image, expected, atol=2e-3)


def test_a_constant_deep_map_is_grey_and_not_an_error(write_map: Any, frame: LocalFrame) -> None:
    window = read(write_map(np.full((24, 40), 7000, dtype=np.uint16)), frame, WHOLE)
    np.testing.assert_allclose(window.image, 0.5)
    assert window.statistics.deviation == 0.0


def test_a_palette_is_shown_in_its_colours(write_map: Any, frame: LocalFrame) -> None:
    colours = {0: (255, 0, 0), 1: (10, 200, 30), 2: (0, 0, 255), 3: (90, 90, 90)}
    index = noise(24, 40, high=4) % 4
    path = write_map(index, colormap=colours, nodata=3, photometric="palette", overviews=(2,))
    window = read(path, frame, WHOLE)
    np.testing.assert_array_equal(window.valid, index != 3)
    table = np.array([colours[k] for k in range(3)] + [(0, 0, 0)])
    np.testing.assert_allclose(window.image, table[index] / 255, atol=1e-6)
    assert read(path, frame, GridBox(-8, -4, 8, 5), gsd_m=4.0).valid.any()


def test_ground_control_points_place_a_map(tmp_path: Path, frame: LocalFrame) -> None:
    pixels, path = noise(24, 40), tmp_path / "gcp.tif"
    shape = {"width": 40, "height": 24, "count": 1}
    with (
        pytest.warns(NotGeoreferencedWarning),
        rasterio.open(path, "w", driver="GTiff", dtype="uint8", **shape) as target,
    ):
        target.write(pixels, 1)
        points = [
            GroundControlPoint(row, column, column * 2.0 - 41.0, 21.0 - row * 2.0)
            for row in (0, 24)
            for column in (0, 40)
        ]
        target.gcps = (points, rasterio.crs.CRS.from_wkt(frame.wkt()))
    np.testing.assert_allclose(read(path, frame, WHOLE).image[..., 1], pixels / 255, atol=1e-4)


def test_statistics_are_those_of_the_whole_map(write_map: Any, frame: LocalFrame) -> None:
    pixels = noise(24, 40, 3)
    pixels[..., 1] //= 3
    with MapReader(write_map(pixels), frame, None) as reader:
        statistics = reader.statistics
    flat = pixels.reshape(-1, 3) / 255
    np.testing.assert_allclose(statistics.mean, flat.mean(axis=0), atol=1e-4)
    assert statistics.deviation == pytest.approx(np.sqrt(flat.var(axis=0).mean()), abs=1e-4)


def test_statistics_of_a_large_map_come_from_an_even_sample(
    write_map: Any, frame: LocalFrame
) -> None:
    x = np.linspace(0, 255, 3000)
    pixels = (np.broadcast_to(x, (1600, 3000)) * 0.5 + noise(1600, 3000) * 0.4).astype(np.uint8)
    with MapReader(write_map(pixels, tiled=True), frame, None) as reader:
        statistics = reader.statistics
    assert statistics.mean[0] == pytest.approx((pixels / 255).mean(), abs=0.01)
    assert statistics.deviation == pytest.approx((pixels / 255).std(), abs=0.01)


def test_overviews_are_read_where_they_are_fine_enough(write_map: Any, frame: LocalFrame) -> None:
    path = write_map(np.full((512, 640), 50, dtype=np.uint8), overviews=(2, 4), tiled=True)
    with rasterio.open(path, "r+") as target:
        target.write(np.full((1, 512, 640), 200, dtype=np.uint8))
    box = GridBox(5, 5, 20, 16)
    for gsd_m, grey in ((2.0, 200), (3.9, 200), (4.0, 50), (9.0, 50)):
        np.testing.assert_allclose(read(path, frame, box, gsd_m).image, grey / 255, atol=1e-5)


@pytest.mark.parametrize(
    ("overviews", "gsd_m", "expected"),
    [
        ([], 9.0, None),
        ([2, 4, 8], 0.9, None),
        ([2, 4, 8], 1.0, 0),
        ([2, 4, 8], 3.9, 2),
        ([8, 2, 4], 2.5, 2),
        ([2, 4, 8], 100.0, 2),
        ([0, 1], 100.0, None),
    ],
)
def test_the_coarsest_overview_that_is_fine_enough_is_chosen(
    overviews: list[int], gsd_m: float, expected: int | None
) -> None:
    assert fitting_overview(overviews, 0.48, gsd_m) == expected


def test_without_overviews_a_coarse_grid_does_not_alias(write_map: Any, frame: LocalFrame) -> None:
    checkerboard = (np.indices((400, 500)).sum(axis=0) % 2 * 255).astype(np.uint8)
    window = read(write_map(checkerboard), frame, GridBox(1, 1, 50, 40), gsd_m=16.7)
    np.testing.assert_allclose(window.image[window.valid], 0.5, atol=0.02)


@pytest.mark.parametrize("gsd_m", [1.3, 2.0, 7.7])
def test_a_window_is_the_same_however_it_is_cut(
    write_map: Any, frame: LocalFrame, gsd_m: float
) -> None:
    east, north = to_crs("EPSG:32614", np.array([frame.lat_deg, frame.lon_deg]))
    transform = Affine(2.0, 0.0, east - 500, 0.0, -2.0, north + 400)
    path = write_map(noise(400, 500, 3), crs="EPSG:32614", transform=transform)
    with MapReader(path, frame, gsd_m) as reader:
        whole = reader.read(GridBox(-40, -30, 80, 60))
        part = reader.read(GridBox(-15, -13, 33, 21))
    np.testing.assert_allclose(part.image, whole.image[17:38, 25:58], atol=0.02)


@pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux alone")
def test_processes_read_what_one_alone_reads(write_map: Any, frame: LocalFrame) -> None:
    path = write_map(noise(240, 400, 3, dtype="uint16", high=4000))
    boxes = [GridBox(column, row, 60, 40) for column in (-20, 50, 130) for row in (-10, 40)] * 4
    with MapReader(path, frame, 2.5) as reader:
        alone = [reader.read(box) for box in boxes]
    with MapReader(path, frame, 2.5) as reader:
        together = list(in_order(reader.read, boxes, 4))
    for window, expected in zip(together, alone, strict=True):
        np.testing.assert_array_equal(window.image, expected.image)
        np.testing.assert_array_equal(window.valid, expected.valid)
        assert window.statistics == expected.statistics


def test_native_gsd_is_in_ground_metres(write_map: Any, frame: LocalFrame) -> None:
    assert native_gsd_m(write_map(noise(24, 40)), frame) == pytest.approx(2.0, rel=1e-6)
    metre_deg = 1 / 111_320
    transform = Affine(3 * metre_deg, 0.0, frame.lon_deg, 0.0, -3 * metre_deg, frame.lat_deg)
    degrees = write_map(noise(24, 40), "degrees.tif", crs="EPSG:4326", transform=transform)
    expected_m = 3.0 * np.sqrt(np.cos(np.radians(frame.lat_deg)))
    assert native_gsd_m(degrees, frame) == pytest.approx(expected_m, rel=3e-3)
    far_away = LocalFrame(-35.0, 149.0)
    assert native_gsd_m(degrees, far_away) == pytest.approx(expected_m, rel=3e-3)


def test_the_real_map_is_read_in_place(shared_dir: Path) -> None:
    path = shared_dir / "flights" / "farms_bing" / "map.tif"
    frame = LocalFrame(23.9563, 56.2230)
    with MapReader(path, frame, None) as reader, rasterio.open(path) as raw:
        window = reader.read(GridBox(-100, -40, 200, 80))
        x, y = np.round(reader.place.to_pixels(np.array([frame.lat_deg, frame.lon_deg])))
        direct = np.moveaxis(raw.read()[:, int(y) - 40 : int(y) + 40, int(x) - 100 :], 0, -1)
    assert window.valid.all()
    difference = window.image - direct[:, :200] / 255
    assert np.abs(difference).mean() < 0.25 * np.abs(window.image - window.image.mean()).mean()
