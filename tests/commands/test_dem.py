"""``--dem``: flat models change nothing, wrong ones are refused, and the run says what it used."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from click.testing import CliRunner
from rasterio.transform import from_origin
from small_flight import HEIGHT_M, MAP_CRS, NORTH_M, WEST_M, Flight

from uasthn_cli.commands.main import main

PLACES = [f"{corner}_{axis}" for corner in ("tl", "br", "center") for axis in ("lat", "lon")]


def write_dem(path: Path, height_m: float, west_m: float = WEST_M) -> Path:
    """Write a level model around the small flight (its altitudes are 50 m above its heights)."""
    transform = from_origin(west_m - 1000.0, NORTH_M + 1000.0, 30.0, 30.0)
    values = np.full((80, 80), height_m, np.float32)
    profile = {"driver": "GTiff", "width": 80, "height": 80, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", crs=MAP_CRS, transform=transform, **profile) as raster:
        raster.write(values, 1)
    return path


def rows(out: Path) -> list[dict[str, str]]:
    with (out / "frames.csv").open(newline="", encoding="utf-8") as handle:
        return list(csv.DictReader(handle))


def test_over_a_flat_model_answers_are_those_of_flat_ground(flight: Flight, tmp_path: Path) -> None:
    dem = write_dem(tmp_path / "dem.tif", 50.0)
    flat, over = tmp_path / "flat", tmp_path / "over"
    assert CliRunner().invoke(main, flight.arguments(flat)).exit_code == 0
    result = CliRunner().invoke(main, flight.arguments(over, "--dem", str(dem)))
    assert result.exit_code == 0, result.stderr
    assert result.stderr.startswith("Heights over dem.tif for 4 of 4 frames; altitudes above sea")
    for ours, theirs in zip(rows(over), rows(flat), strict=True):
        assert ours["source"] == theirs["source"] == "fused"
        for name in PLACES:
            assert float(ours[name]) == pytest.approx(float(theirs[name]), abs=2e-7)
        assert float(ours["agl_m"]) == pytest.approx(HEIGHT_M, abs=0.01)


def test_the_record_says_what_heights_rest_on(flight: Flight, tmp_path: Path) -> None:
    dem, out = write_dem(tmp_path / "dem.tif", 30.0), tmp_path / "out"
    arguments = flight.arguments(out, "--dem", str(dem), "--dem-datum", "flight")
    assert CliRunner().invoke(main, arguments).exit_code == 0
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert len(run["inputs"]["dem"]["sha256"]) == 64
    assert run["notes"]["ground"]["datum"] == "flight"
    assert run["notes"]["ground"]["zero_m"] == 30.0
    assert run["notes"]["ground"]["frames"] == 4
    assert run["notes"]["height_source"] == "dem"


def test_frames_tell_a_datum_that_is_far_off(flight: Flight, tmp_path: Path) -> None:
    dem = write_dem(tmp_path / "dem.tif", 90.0)  # altitudes above sea level are 40 m too low for it
    out = tmp_path / "out"
    result = CliRunner().invoke(main, flight.arguments(out, "--dem", str(dem)))
    assert result.exit_code == 0, result.stderr
    assert "right on the flight's average" in result.stderr
    assert "frames fit better" in result.stderr


@pytest.mark.parametrize(
    ("make", "exit_code", "words"),
    [
        (lambda path: path, 15, "no such elevation model"),
        (lambda path: write_dem(path, 50.0, WEST_M + 50_000.0), 17, "the elevation model has no"),
    ],
    ids=["missing", "elsewhere"],
)
def test_a_model_that_cannot_be_used(
    flight: Flight, tmp_path: Path, make: object, exit_code: int, words: str
) -> None:
    dem, out = tmp_path / "dem.tif", tmp_path / "out"
    assert callable(make)
    make(dem)
    result = CliRunner().invoke(main, flight.arguments(out, "--dem", str(dem)))
    assert result.exit_code == exit_code, result.stderr
    assert words in result.stderr
    assert result.stderr.count("\n") == 1
    assert not out.exists()


def test_one_height_for_all_contradicts_a_model(flight: Flight, tmp_path: Path) -> None:
    extra = ("--dem", str(tmp_path / "dem.tif"), "--height-m", "100")
    result = CliRunner().invoke(main, flight.arguments(tmp_path / "out", *extra))
    assert result.exit_code == 2
    assert "leave out --height-m" in result.stderr
