"""Heights of an elevation model, whatever its CRS, unit and holes, in the flight's own metres."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import NDArray
from rasterio.crs import CRS
from rasterio.warp import transform as warp_points

from uasthn_cli.errors import MapElsewhereError, MapUnreadableError, MapWithoutCrsError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.mapping.elevation import read_relief

FRAME = LocalFrame(47.05, -99.2)
HERE = np.array([[47.05, -99.2]])
SIZE = 120
SLOPE_EAST, SLOPE_NORTH, MIDDLE_M = 0.08, -0.05, 400.0


def write_model(
    path: Path, crs: str | None, pixel: float, values: NDArray[Any] | None = None, **profile: Any
) -> Path:
    """Write a slope (as seen in the flight's own metres), or values, around the flight."""
    middle_x, middle_y = 0.0, 0.0
    if crs is not None:
        (middle_x,), (middle_y,) = warp_points("EPSG:4326", crs, [-99.2], [47.05])
    transform = Affine(
        pixel, 0.0, middle_x - pixel * SIZE / 2, 0.0, -pixel, middle_y + pixel * SIZE / 2
    )
    if values is None:
        columns, rows = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
        x, y = transform.a * columns + transform.c, transform.e * rows + transform.f
        local = CRS.from_wkt(FRAME.wkt())
        east, north = warp_points(crs, local, x.ravel().tolist(), y.ravel().tolist())
        values = (MIDDLE_M + SLOPE_EAST * np.array(east) + SLOPE_NORTH * np.array(north)).reshape(
            SIZE, SIZE
        )
    scaling = {key: profile.pop(key) for key in ("units", "scales", "offsets") if key in profile}
    kind: dict[str, Any] = {"driver": "GTiff", "width": SIZE, "height": SIZE, "count": 1}
    kind |= {"dtype": values.dtype, "crs": crs, "transform": transform} | profile
    with rasterio.open(path, "w", **kind) as raster:
        raster.write(values, 1)
        for key, value in scaling.items():
            setattr(raster, key, (value,))
    return path


@pytest.mark.parametrize(
    ("crs", "pixel"), [("EPSG:32614", 10.0), ("EPSG:4326", 1e-4), ("EPSG:3857", 15.0)]
)
def test_convention_a_slope_is_the_same_slope_in_any_crs(
    tmp_path: Path, crs: str, pixel: float
) -> None:
    path = write_model(tmp_path / "dem.tif", crs, pixel)
    relief = read_relief(path, FRAME, HERE, 200.0)
    places_m = np.random.default_rng(0).uniform(-200.0, 200.0, (50, 2))
    expected_m = MIDDLE_M + places_m @ (SLOPE_EAST, SLOPE_NORTH)
    assert relief.heights_m(places_m) == pytest.approx(expected_m, abs=0.1)


def test_unit_scale_and_offset_are_respected(tmp_path: Path) -> None:
    feet = np.full((SIZE, SIZE), 1000, np.int16)
    path = write_model(
        tmp_path / "dem.tif", "EPSG:32614", 10.0, feet, units="ft", scales=0.5, offsets=100.0
    )
    found_m = read_relief(path, FRAME, HERE, 50.0).heights_m(np.zeros(2))
    assert found_m == pytest.approx(600.0 * 0.3048)


@pytest.mark.parametrize("nodata", [-9999.0, None], ids=["declared", "not declared"])
def test_missing_data_spoils_no_height_near_it(tmp_path: Path, nodata: float | None) -> None:
    values = np.full((SIZE, SIZE), 250.0, np.float32)
    values[:, 65:] = -9999.0
    path = write_model(tmp_path / "dem.tif", "EPSG:32614", 10.0, values, nodata=nodata)
    relief = read_relief(path, FRAME, HERE, 300.0)
    assert relief.heights_m(np.array([-100.0, 0.0])) == pytest.approx(250.0)
    assert np.isnan(relief.heights_m(np.array([200.0, 0.0])))
    known_m = relief.values_m[np.isfinite(relief.values_m)]
    assert known_m == pytest.approx(250.0)


def test_beyond_the_model_nothing_is_known(tmp_path: Path) -> None:
    path = write_model(tmp_path / "dem.tif", "EPSG:32614", 2.0)
    relief = read_relief(path, FRAME, HERE, 1000.0)
    assert np.isfinite(relief.heights_m(np.zeros(2)))
    assert np.isnan(relief.heights_m(np.array([0.0, 500.0])))


def test_a_large_area_is_read_on_a_coarser_grid(tmp_path: Path) -> None:
    path = write_model(tmp_path / "dem.tif", "EPSG:32614", 10.0)
    relief = read_relief(path, FRAME, HERE, 40_000.0)
    assert max(relief.values_m.shape) <= 2_003


def test_errors_name_the_file_and_what_it_should_be(tmp_path: Path) -> None:
    away = np.array([[48.0, -99.2]])
    path = write_model(tmp_path / "dem.tif", "EPSG:32614", 10.0)
    with pytest.raises(MapElsewhereError, match=r"dem.tif: the elevation model .* 10\d.\d km"):
        read_relief(path, FRAME, away, 100.0)
    with pytest.raises(MapUnreadableError, match="no such elevation model"):
        read_relief(tmp_path / "none.tif", FRAME, HERE, 100.0)
    (tmp_path / "text.tif").write_text("heights")
    with pytest.raises(MapUnreadableError, match="cannot open the elevation model"):
        read_relief(tmp_path / "text.tif", FRAME, HERE, 100.0)
    values = np.zeros((SIZE, SIZE), np.float32)
    bare = write_model(tmp_path / "bare.tif", None, 10.0, values)
    with pytest.raises(MapWithoutCrsError, match="the elevation model has no coordinate"):
        read_relief(bare, FRAME, HERE, 100.0)
