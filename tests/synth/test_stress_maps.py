"""What happens to maps: the grid stays, and the ground on it is what was asked for."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from rasterio.transform import Affine, from_origin

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.mapping.georeference import Georeference
from uasthn_cli.synth.repetition import Pattern, Repetition, draw_repetition
from uasthn_cli.synth.stress_maps import (
    MapImage,
    cut_off,
    of_another_place,
    outdated,
    read_map,
    repeated,
    write_changed_map,
)

WIDTH, HEIGHT = 130, 90
UTM = rasterio.crs.CRS.from_epsg(32614)


def flat_map(
    transform: Affine | None = None,
    crs: rasterio.crs.CRS = UTM,
    size: tuple[int, int] | None = None,
) -> MapImage:
    width, height = size or (WIDTH, HEIGHT)
    grid = transform or from_origin(500_000.0, 5_200_000.0, 1.0, 1.0)
    bands = np.full((3, height, width), 100, np.uint8)
    return MapImage(bands, Georeference(crs.to_wkt(), grid, width, height))


def write_donor(path: Path, gsd_m: float, period_m: float, size: tuple[int, int]) -> Path:
    """Write a striped place: brightness is a cosine of the metres east."""
    width, height = size
    east_m = (np.arange(width) + 0.5) * gsd_m
    stripes = (128 + 100 * np.cos(2 * np.pi * east_m / period_m)).astype(np.uint8)
    grid = from_origin(400_000.0, 2_600_000.0, gsd_m, gsd_m)
    crs = rasterio.crs.CRS.from_epsg(32640)
    place = Georeference(crs.to_wkt(), grid, width, height)
    write_changed_map(path, MapImage(np.broadcast_to(stripes, (3, height, width)), place))
    return path


def period_of(row: NDArray[np.uint8], gsd_m: float) -> float:
    """Return the strongest period of a row in metres."""
    power = np.abs(np.fft.rfft(row - row.mean()))
    return row.size * gsd_m / float(np.argmax(power))


@pytest.mark.parametrize("donor_gsd_m", [0.5, 1.0, 4.0])
def test_donors_keep_their_scale(donor_gsd_m: float, tmp_path: Path) -> None:
    donor = write_donor(tmp_path / "donor.tif", donor_gsd_m, 26.0, (400, 300))
    shown = of_another_place(flat_map(), np.random.default_rng(0), (donor,))
    assert shown.bands.shape == (3, HEIGHT, WIDTH)
    assert period_of(shown.bands[0, HEIGHT // 2], 1.0) == pytest.approx(26.0, rel=0.05)
    assert shown.bands.std() > 50.0


def test_small_donors_are_mirrored(tmp_path: Path) -> None:
    donor = write_donor(tmp_path / "donor.tif", 1.0, 10.0, (40, 30))
    shown = of_another_place(flat_map(), np.random.default_rng(0), (donor,))
    blocks = shown.bands[0].reshape(HEIGHT // 30, 30, WIDTH)
    assert (blocks.std(axis=(1, 2)) > 50.0).all()


def test_places_differ_by_seed_and_keep_the_grid() -> None:
    image = flat_map()
    a, b = (of_another_place(image, np.random.default_rng(seed)) for seed in (0, 1))
    assert a.place == b.place == image.place
    assert (a.bands != b.bands).mean() > 0.9


def test_a_map_in_degrees_gets_square_metres() -> None:
    step = 1.0 / 111_320.0
    grid = from_origin(-99.0, 60.0, 2.0 * step, step)
    image = flat_map(grid, rasterio.crs.CRS.from_epsg(4326))
    assert image.pixel_m == pytest.approx([1.0, 1.0], rel=0.01)


@given(severity=st.floats(0.05, 1.0), seed=st.integers(0, 1000))
def test_what_is_cut_off_is_the_share_asked_for(severity: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    seen_px = rng.uniform([30.0, 25.0], [100.0, 65.0], (5, 200, 2))
    cut, on_map = cut_off(flat_map(), seen_px, severity, rng)
    assert on_map.shape == (5,)
    assert on_map.mean() == pytest.approx(1.0 - severity, abs=0.05)
    assert cut.bands.shape == (3, cut.place.height_px, cut.place.width_px)
    assert (cut.place.width_px < WIDTH) != (cut.place.height_px < HEIGHT)


def test_a_map_that_the_flight_fills_cannot_be_left_behind() -> None:
    rng = np.random.default_rng(0)
    seen_px = rng.uniform([0.0, 0.0], [WIDTH - 1.0, HEIGHT - 1.0], (5, 500, 2))
    with pytest.raises(SyntheticFlightError, match="lower severity or a larger map"):
        cut_off(flat_map(), seen_px, 1.0, rng)


@pytest.mark.parametrize("severity", [0.0, 0.37, 1.0])
def test_so_much_of_the_map_is_out_of_date(severity: float) -> None:
    image = flat_map(size=(64, 48))
    changed = outdated(image, severity, np.random.default_rng(4), patch_m=20.0)
    share = (changed.bands != image.bands).any(axis=0).mean()
    assert share == pytest.approx(severity, abs=0.03)


@given(
    pattern=st.sampled_from(Pattern),
    angle_rad=st.floats(0.0, 3.14),
    period_m=st.floats(10.0, 80.0),
    steps=st.integers(-40, 40),
)
def test_patterns_repeat_without_end(
    pattern: Pattern, angle_rad: float, period_m: float, steps: int
) -> None:
    repetition = Repetition(pattern, period_m, angle_rad, (3.0, 5.0), -1.0)
    points_m = np.random.default_rng(0).uniform(-200.0, 200.0, (20, 15, 2))
    across_m = steps * period_m * np.array([np.cos(angle_rad), np.sin(angle_rad)])
    for look in (repetition.day, repetition.night):
        assert look(points_m + across_m) == pytest.approx(look(points_m), abs=1e-3)
        assert look(points_m).std() > 0.3


def test_every_pattern_is_drawn() -> None:
    drawn = {draw_repetition(np.random.default_rng(seed), 200.0).pattern for seed in range(40)}
    assert drawn == set(Pattern)


def test_repetition_takes_the_place_of_landmarks() -> None:
    image = flat_map()
    bands = image.bands.copy()
    bands[:, 40:50, 60:70] = 250
    repetition = Repetition(Pattern.ROWS, 20.0, 0.4, (0.0, 0.0), 1.0)
    landmark = MapImage(bands, image.place)
    plain, marked = (
        repeated(m, repetition, 1.0, np.random.default_rng(0)).bands.astype(float)
        for m in (MapImage(np.roll(bands, 30, axis=1), image.place), landmark)
    )
    assert np.array_equal(plain, marked), "where the landmark stood no longer shows"


def test_maps_of_more_than_8_bits_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.tif"
    profile = {"driver": "GTiff", "width": 20, "height": 10, "count": 1, "dtype": "uint16"}
    grid = from_origin(500_000.0, 5_200_000.0, 1.0, 1.0)
    with rasterio.open(path, "w", crs=UTM, transform=grid, **profile) as raster:
        raster.write(np.ones((1, 10, 20), np.uint16))
    with pytest.raises(SyntheticFlightError, match="8 bits"):
        read_map(path)
