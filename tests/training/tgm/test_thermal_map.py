"""A map's thermal image: the map's pixels, windowed generation, no seams."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import NDArray
from rasterio.windows import Window
from tiny_tgm import tiny_generator, write_tiny_generator
from tiny_training import pattern

from uasthn_cli.errors import MapWithoutCrsError, OutputError, TrainingDataError
from uasthn_cli.training.tgm.thermal_map import ThermalMap

CRS = "EPSG:32640"


def write_map(
    path: Path, height_px: int, width_px: int, *, gsd_m: float = 2.0, hole: bool = False
) -> NDArray[np.uint8]:
    """Write a colour map and return its pixels ``(h, w, 3)``; ``hole``: a corner has no data."""
    planes = [pattern(seed, height_px, width_px) * 254 + 1 for seed in range(3)]
    pixels = np.stack(planes).astype(np.uint8)
    if hole:
        pixels[:, :30, :40] = 0
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=height_px,
        width=width_px,
        count=3,
        dtype="uint8",
        crs=CRS,
        transform=Affine(gsd_m, 0, 500_000, 0, -gsd_m, 2_600_000),
        nodata=0 if hole else None,
    ) as target:
        target.write(pixels)
    return np.moveaxis(pixels, 0, -1)


def read(path: Path) -> NDArray[np.uint8]:
    with rasterio.open(path) as source:
        pixels: NDArray[np.uint8] = source.read(1)
    return pixels


def test_it_has_the_maps_pixels_and_georeference(tmp_path: Path) -> None:
    write_map(tmp_path / "map.tif", 110, 150, hole=True)
    thermal = ThermalMap(tiny_generator(), tmp_path / "map.tif")
    drawn: list[int] = []
    thermal.write(tmp_path / "sub" / "thermal.tif", on_tile=drawn.append)
    assert drawn == list(range(1, thermal.tiles + 1))
    with (
        rasterio.open(tmp_path / "map.tif") as source,
        rasterio.open(tmp_path / "sub" / "thermal.tif") as target,
    ):
        assert (target.count, target.dtypes, target.nodata) == (1, ("uint8",), 0)
        assert target.crs == source.crs
        assert target.transform == source.transform
        assert (target.width, target.height) == (150, 110)
        assert (target.dataset_mask() == source.dataset_mask()).all()
    assert [path.name for path in (tmp_path / "sub").iterdir()] == ["thermal.tif"]


def test_inside_a_tile_it_is_what_the_window_alone_gives(tmp_path: Path) -> None:
    pixels = write_map(tmp_path / "map.tif", 160, 112)
    generator = tiny_generator()  # tiles of 64 px, 16 px in common with the next
    ThermalMap(generator, tmp_path / "map.tif").write(tmp_path / "thermal.tif")
    drawn = read(tmp_path / "thermal.tif")
    for row in (0, 48, 96):
        for column in (0, 48):
            window = generator.render(pixels[row : row + 64, column : column + 64])
            inner = np.s_[16 if row else 0 : 48, 16 if column else 0 : 48]
            expected = np.maximum(window[inner], 1)
            assert (drawn[row : row + 64, column : column + 64][inner] == expected).all()


def test_tiles_are_blended_where_they_meet(tmp_path: Path) -> None:
    pixels = write_map(tmp_path / "map.tif", 64, 112)
    generator = tiny_generator()
    ThermalMap(generator, tmp_path / "map.tif").write(tmp_path / "thermal.tif")
    left = generator.render(pixels[:, :64])[:, 48:].astype(float)
    right = generator.render(pixels[:, 48:])[:, :16].astype(float)
    weight = (np.arange(16) + 0.5) / 16
    expected = left * (1 - weight) + right * weight
    assert np.abs(read(tmp_path / "thermal.tif")[:, 48:64] - expected).max() <= 0.51
    assert np.abs(left - right).mean() > 1  # there was something to blend


@pytest.mark.parametrize("gsd_m", [1.0, 3.1])
def test_a_map_is_read_at_the_generators_scale(tmp_path: Path, gsd_m: float) -> None:
    pixels = write_map(tmp_path / "map.tif", 40, 45, gsd_m=gsd_m)
    generator = tiny_generator()
    thermal = ThermalMap(generator, tmp_path / "map.tif")
    assert thermal.tiles == (1 if gsd_m == 1.0 else 2)
    thermal.write(tmp_path / "thermal.tif")
    drawn = read(tmp_path / "thermal.tif")
    assert drawn.shape == (40, 45)
    assert drawn.std() > 3
    if gsd_m < 2:
        assert not (drawn == generator.render(pixels)).all()


def test_three_pixels_are_a_map(tmp_path: Path) -> None:
    write_map(tmp_path / "map.tif", 1, 3)
    ThermalMap(tiny_generator(), tmp_path / "map.tif").write(tmp_path / "thermal.tif")
    assert read(tmp_path / "thermal.tif").shape == (1, 3)


def test_the_same_map_gives_the_same_bytes(tmp_path: Path) -> None:
    write_map(tmp_path / "map.tif", 70, 90)
    for name in ("a.tif", "b.tif"):
        ThermalMap(tiny_generator(), tmp_path / "map.tif").write(tmp_path / name)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


def test_nothing_is_replaced_unasked(tmp_path: Path) -> None:
    write_map(tmp_path / "map.tif", 40, 40)
    out = tmp_path / "thermal.tif"
    out.write_bytes(b"old")
    thermal = ThermalMap(tiny_generator(), tmp_path / "map.tif")
    with pytest.raises(OutputError, match="add --overwrite"):
        thermal.write(out)
    assert out.read_bytes() == b"old"
    thermal.write(out, overwrite=True)
    assert read(out).shape == (40, 40)


def test_a_failure_half_way_leaves_what_was_there(tmp_path: Path) -> None:
    write_map(tmp_path / "map.tif", 200, 40)
    out = tmp_path / "thermal.tif"
    out.write_bytes(b"old")

    def interrupt(tile: int) -> None:
        if tile == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ThermalMap(tiny_generator(), tmp_path / "map.tif").write(
            out, overwrite=True, on_tile=interrupt
        )
    assert out.read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.tif", "thermal.tif"]


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    write_map(tmp_path / "map.tif", 40, 40)
    thermal = ThermalMap(tiny_generator(), tmp_path / "map.tif")
    (tmp_path / "folder.tif").mkdir()
    (tmp_path / "file").write_text("")
    for name, message in {
        "thermal.png": "ends in .tif",
        "folder.tif": "is a folder",
        "map.tif": "is the map itself",
        "file/thermal.tif": "cannot create",
    }.items():
        with pytest.raises(OutputError, match=message):
            thermal.write(tmp_path / name, overwrite=True)


def test_wrong_maps_are_refused(tmp_path: Path) -> None:
    write_map(tmp_path / "coarse.tif", 40, 40, gsd_m=30.0)
    with pytest.raises(TrainingDataError, match=r"trained at 2 m; resample .* -tr 2 2"):
        ThermalMap(tiny_generator(), tmp_path / "coarse.tif")
    with rasterio.open(
        tmp_path / "plain.tif", "w", driver="GTiff", height=8, width=8, count=3, dtype="uint8"
    ) as target:
        target.write(np.zeros((3, 8, 8), np.uint8))
    with pytest.raises(MapWithoutCrsError):
        ThermalMap(tiny_generator(), tmp_path / "plain.tif")


PROBE = """
import resource, sys
from pathlib import Path
import torch
from uasthn_cli.training.tgm.thermal_generator import ThermalGenerator
from uasthn_cli.training.tgm.thermal_map import ThermalMap
generator = ThermalGenerator.open(Path(sys.argv[1]), "cpu")
ThermalMap(generator, Path(sys.argv[2])).write(Path(sys.argv[2] + ".out.tif"))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_map(tmp_path: Path) -> None:
    if sys.platform != "linux":
        pytest.skip("peak memory is counted in other units here")
    weights = write_tiny_generator(tmp_path / "t.safetensors", size_px=256)
    peaks_mb = []
    for side_px in (600, 12_000):
        path = tmp_path / f"{side_px}.tif"
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            height=side_px,
            width=side_px,
            count=3,
            dtype="uint8",
            crs=CRS,
            nodata=0,
            transform=Affine(2, 0, 500_000, 0, -2, 2_600_000),
            tiled=True,
            SPARSE_OK=True,
        ) as target:
            patch = np.random.default_rng(0).integers(1, 255, (3, 250, 250), dtype=np.uint8)
            target.write(patch, window=Window(20, 20, 250, 250))
        run = subprocess.run(
            [sys.executable, "-c", PROBE, weights, path], capture_output=True, text=True, check=True
        )
        peaks_mb.append(float(run.stdout))
    assert peaks_mb[1] < peaks_mb[0] + 130  # a map of floats would be 576 MB
