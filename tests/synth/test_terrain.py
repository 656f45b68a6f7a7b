"""Relief: which way slopes, light and shadows point; what noise and dunes look like."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uasthn_cli.synth.dunes import dune_field
from uasthn_cli.synth.layout import Axes, Plot, divide
from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.synth.terrain import cast_shadow, hollowness, slopes, sunlight
from uasthn_cli.types import ImageArray

EAST, NORTH = math.radians(90.0), 0.0
SHAPE = (40, 70)


def test_convention_slopes_point_east_and_north() -> None:
    y, x = np.indices(SHAPE, dtype=np.float32)
    east, north = slopes(0.2 * x - 0.3 * y, 2.0)
    assert east[5:-5, 5:-5] == pytest.approx(0.1, abs=1e-5)
    assert north[5:-5, 5:-5] == pytest.approx(0.15, abs=1e-5)


def test_flat_ground_has_unit_light() -> None:
    light = sunlight(np.zeros(SHAPE, np.float32), 1.0, EAST, math.radians(50.0))
    assert light == pytest.approx(1.0)


def test_slopes_that_face_the_sun_are_brighter() -> None:
    _, x = np.indices(SHAPE, dtype=np.float32)
    falling_east = -0.2 * x
    assert sunlight(falling_east, 1.0, EAST, 0.8)[20, 30] > 1.1
    assert sunlight(falling_east, 1.0, EAST + math.pi, 0.8)[20, 30] < 0.9


@pytest.mark.parametrize(
    ("azimuth_rad", "shaded", "sunny"),
    [(EAST, (20, 27), (20, 37)), (NORTH, (28, 32), (14, 32))],
)
def test_convention_shadows_fall_away_from_the_sun(
    azimuth_rad: float, shaded: tuple[int, int], sunny: tuple[int, int]
) -> None:
    above_m = np.zeros(SHAPE, dtype=np.float32)
    above_m[18:25, 30:35] = 5.0
    shadow = cast_shadow(above_m, 1.0, azimuth_rad, math.radians(45.0))
    assert shadow[shaded] == 1.0
    assert shadow[sunny] == 0.0
    assert shadow[20, 32] == 0.0


def test_shadow_is_as_long_as_the_height_over_the_tangent() -> None:
    above_m = np.zeros((9, 60), dtype=np.float32)
    above_m[:, 40] = 10.0
    shadow = cast_shadow(above_m, 1.0, EAST, math.atan(0.5))
    assert 18 <= int((shadow[4] > 0.5).sum()) <= 20


def test_hollows_are_positive() -> None:
    y, x = np.indices((80, 80), dtype=np.float32)
    bowl: ImageArray = np.float32(0.01) * ((x - 40.0) ** 2 + (y - 40.0) ** 2)
    assert hollowness(bowl, 1.0, 8.0)[40, 40] > 0.5


def test_noise_is_standardised_and_smooth_down_to_its_finest_wave() -> None:
    rng = np.random.default_rng(1)
    coarse = fractal_noise(rng, (150, 260), 1.0, 60.0, finest_m=20.0)
    fine = fractal_noise(rng, (150, 260), 1.0, 60.0, finest_m=1.0, roughness=0.8)
    for field in (coarse, fine):
        assert field.shape == (150, 260)
        assert abs(float(field.mean())) < 1e-3
        assert float(field.std()) == pytest.approx(1.0, abs=1e-3)
    assert np.diff(coarse, axis=1).std() < 0.3 * np.diff(fine, axis=1).std()


def test_wide_blur_agrees_with_the_exact_one() -> None:
    field = fractal_noise(np.random.default_rng(2), (200, 300), 1.0, 80.0)
    exact = cv2.GaussianBlur(field, (0, 0), 9.0)
    middle = (slice(30, -30), slice(30, -30))
    difference = (smooth(field, 9.0) - exact)[middle]
    assert np.abs(difference).max() < 0.15 * exact[middle].std() + 0.02


@pytest.mark.parametrize("wind_rad", [0.0, 2.0])
def test_dunes_are_steeper_downwind(wind_rad: float) -> None:
    dunes = dune_field(np.random.default_rng(3), (300, 360), 1.0, spacing_m=60.0, wind_rad=wind_rad)
    east, north = slopes(dunes, 1.0)
    along = east * math.cos(wind_rad) - north * math.sin(wind_rad)
    skewness = float(np.mean((along - along.mean()) ** 3) / along.std() ** 3)
    assert skewness < -0.3


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    width_m=st.floats(30.0, 900.0),
    length_m=st.floats(30.0, 900.0),
)
def test_division_tiles_the_plot(seed: int, width_m: float, length_m: float) -> None:
    plot = Plot(-10.0, 5.0, width_m - 10.0, length_m + 5.0)
    pieces = divide(np.random.default_rng(seed), plot, 120.0, 40.0)
    area = sum(piece.width_m * piece.length_m for piece in pieces)
    assert area == pytest.approx(width_m * length_m)
    assert all(piece.width_m > 0.0 and piece.length_m > 0.0 for piece in pieces)


def test_convention_axes_turn_from_x_to_y() -> None:
    axes = Axes((30.0, 10.0), math.pi / 2.0, 2.0)
    assert axes.to_px(np.array([[4.0, 0.0]]))[0] == pytest.approx([30.0, 12.0])
    assert axes.to_px(np.array([[0.0, 4.0]]))[0] == pytest.approx([28.0, 10.0])
