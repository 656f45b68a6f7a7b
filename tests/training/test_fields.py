"""Random fields and image operations: what they promise in numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_training import pattern

from uasthn_cli.training.fields import (
    blur,
    directional_derivative,
    fractal_noise,
    riesz_transform,
    standardise,
)

IMAGE = pattern(0, 31, 45)  # odd sizes: no frequency without a partner

azimuths = st.floats(0, 2 * np.pi)


def energy(image: np.ndarray) -> float:
    return float((image.astype(np.float64) ** 2).sum())


@given(azimuths)
def test_riesz_along_and_across_keep_the_energy(azimuth_rad: float) -> None:
    along = riesz_transform(IMAGE, azimuth_rad)
    across = riesz_transform(IMAGE, azimuth_rad + np.pi / 2)
    assert energy(along) + energy(across) == pytest.approx(energy(IMAGE - IMAGE.mean()), rel=1e-4)


@given(azimuths)
def test_riesz_is_steered_by_its_azimuth(azimuth_rad: float) -> None:
    right, down = riesz_transform(IMAGE, 0.0), riesz_transform(IMAGE, np.pi / 2)
    steered = np.cos(azimuth_rad) * right + np.sin(azimuth_rad) * down
    assert riesz_transform(IMAGE, azimuth_rad) == pytest.approx(steered, abs=1e-5)


def test_riesz_turns_with_the_image() -> None:
    turned = riesz_transform(np.ascontiguousarray(np.rot90(IMAGE)), -np.pi / 2)
    assert turned == pytest.approx(np.rot90(riesz_transform(IMAGE, 0.0)), abs=1e-5)


@pytest.mark.parametrize("cycles", [1, 3, 11])
def test_riesz_of_a_wave_is_the_wave_a_quarter_later_at_any_scale(cycles: int) -> None:
    phase = 2 * np.pi * cycles * np.arange(45) / 45
    wave = np.broadcast_to(np.cos(phase), (31, 45)).astype(np.float32)
    assert riesz_transform(wave, 0.0) == pytest.approx(
        np.broadcast_to(-np.sin(phase), (31, 45)), abs=1e-4
    )
    assert np.abs(riesz_transform(wave, np.pi / 2)).max() < 1e-4


def test_riesz_of_flat_ground_is_nothing() -> None:
    assert np.abs(riesz_transform(np.full((16, 24), 0.7, np.float32), 1.0)).max() < 1e-6


@given(azimuths)
def test_convention_slope_of_a_plane_towards_an_azimuth(azimuth_rad: float) -> None:
    rows, columns = np.mgrid[0:20, 0:30].astype(np.float32)
    plane = np.asarray(0.5 * columns - 0.25 * rows, dtype=np.float32)
    expected = 0.5 * np.cos(azimuth_rad) - 0.25 * np.sin(azimuth_rad)
    assert directional_derivative(plane, azimuth_rad) == pytest.approx(
        np.full((20, 30), expected), abs=1e-5
    )


def test_standardise() -> None:
    standardised = standardise(3 * IMAGE + 7)
    assert abs(float(standardised.mean())) < 1e-4
    assert float(standardised.std()) == pytest.approx(1, abs=1e-3)
    assert np.isfinite(standardise(np.ones((4, 5), np.float32))).all()


def test_blur_keeps_the_mean_of_flat_ground_and_spreads_a_point() -> None:
    point = np.zeros((41, 41), np.float32)
    point[20, 20] = 1
    spread = blur(point, 3.0)
    offsets = np.arange(41) - 20.0
    assert float(spread.sum()) == pytest.approx(1, abs=1e-3)
    assert float((spread.sum(axis=0) * offsets**2).sum()) == pytest.approx(9, rel=0.05)


def test_fractal_noise_is_as_smooth_as_its_scale() -> None:
    def roughness(scale_px: float) -> float:
        field = fractal_noise(np.random.default_rng(0), 128, scale_px, 1)
        return float(np.diff(field).std() / field.std())

    assert roughness(64) < roughness(16) < roughness(4)
    again = fractal_noise(np.random.default_rng(0), 128, 64, 3)
    assert np.array_equal(again, fractal_noise(np.random.default_rng(0), 128, 64, 3))
    assert again.shape == (128, 128)
