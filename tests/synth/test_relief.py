"""Relief: its height over the rendered area, its slopes, and the DEM that tells of it."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st

from uasthn_cli.errors import OutputError, SyntheticFlightError
from uasthn_cli.geometry.geodesy import LocalFrame, from_crs, to_crs
from uasthn_cli.synth.map_raster import Ground
from uasthn_cli.synth.relief import (
    DEM_GSD_M,
    DEM_NODATA,
    MEAN_GROUND_AMSL_M,
    Relief,
    draw_relief,
    write_dem,
)
from uasthn_cli.types import FloatArray

GROUND = Ground(LocalFrame(46.95, -97.1), -300.0, 900.0, 2.0, 800, 550)
CRS = "EPSG:32614"


def places(ground: Ground, spacing_m: float = 7.0) -> FloatArray:
    """Return points ``(h, w, 2)`` all over a ground."""
    east = np.arange(0.0, ground.width_px * ground.gsd_m, spacing_m) + ground.west_m
    north = ground.north_m - np.arange(0.0, ground.height_px * ground.gsd_m, spacing_m)
    return np.stack(np.meshgrid(east, north), axis=-1)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), relief_m=st.floats(1.0, 60.0))
def test_relief_is_as_high_as_asked_and_smooth(seed: int, relief_m: float) -> None:
    relief = draw_relief(np.random.default_rng(seed), GROUND, relief_m)
    heights = relief.at(places(GROUND))
    assert np.ptp(heights) == pytest.approx(relief_m, rel=0.01)
    assert abs(heights.mean()) < 0.01 * relief_m
    assert np.abs(np.diff(heights, axis=1)).max() < 0.5 * 7.0
    assert relief_m * 0.1 < heights.std() < relief_m * 0.4


def test_same_random_numbers_same_relief() -> None:
    first, second = (draw_relief(np.random.default_rng(3), GROUND, 40.0) for _ in range(2))
    assert (first.heights_m == second.heights_m).all()


def test_convention_heights_lie_where_east_and_north_say() -> None:
    heights = np.arange(12.0).reshape(3, 4)
    relief = Relief(100.0, 500.0, heights)
    points = np.array([[100.0, 500.0], [130.0, 500.0], [100.0, 480.0], [115.0, 495.0]])
    assert relief.at(points) == pytest.approx([0.0, 3.0, 8.0, 3.5])
    assert relief.at(np.array([[-1e5, 1e5]])) == pytest.approx([0.0])


def test_the_dem_is_the_relief_above_sea_level_around_the_map(tmp_path: Path) -> None:
    relief = draw_relief(np.random.default_rng(8), GROUND, 60.0)
    write_dem(tmp_path / "dem.tif", relief, GROUND, CRS)
    with rasterio.open(tmp_path / "dem.tif") as raster:
        assert raster.crs.to_epsg() == 32614
        assert raster.dtypes == ("float32",)
        assert raster.nodata == DEM_NODATA
        assert raster.res == (DEM_GSD_M, DEM_GSD_M)
        values = raster.read(1)
        bounds = raster.bounds
        columns, rows = np.meshgrid(np.arange(raster.width), np.arange(raster.height))
        xs = bounds.left + DEM_GSD_M * (columns + 0.5)
        ys = bounds.top - DEM_GSD_M * (rows + 0.5)
    local_m = GROUND.frame.to_metres(from_crs(CRS, np.stack([xs, ys], axis=-1)))
    assert np.abs(values - MEAN_GROUND_AMSL_M - relief.at(local_m)).max() < 0.01
    edge = to_crs(CRS, GROUND.frame.to_degrees(GROUND.edge_m())).reshape(-1, 2)
    assert (edge.min(axis=0) - (bounds.left, bounds.bottom) > 150.0).all()
    assert ((bounds.right, bounds.top) - edge.max(axis=0) > 150.0).all()
    height, width = relief.heights_m.shape
    inside = (local_m[..., 0] - relief.west_m < width * DEM_GSD_M) & (
        relief.north_m - local_m[..., 1] < height * DEM_GSD_M
    )
    assert inside.all(), "the DEM reaches beyond the relief"


def test_cliffs_are_refused() -> None:
    small = Ground(GROUND.frame, 0.0, 0.0, 1.0, 120, 100)
    with pytest.raises(SyntheticFlightError, match="less relief or more frames"):
        draw_relief(np.random.default_rng(0), small, 300.0)


def test_a_dem_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    relief = draw_relief(np.random.default_rng(8), GROUND, 10.0)
    with pytest.raises(OutputError, match="cannot write"):
        write_dem(tmp_path / "missing" / "dem.tif", relief, GROUND, CRS)
