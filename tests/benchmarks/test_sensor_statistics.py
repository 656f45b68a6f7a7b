"""Each measure finds what was put in, whatever scene lies under it."""

import numpy as np
import pytest
from sensor_statistics import (
    clipped_share,
    drift_share,
    noise_share,
    spectral_slope,
    stripe_share,
)
from tiny_training import pattern

from uasthn_cli.training.fields import blur, standardise

SCENE = standardise(pattern(3, 77, 96, sigma_px=6.0))
RNG_SEEDS = range(5)


@pytest.mark.parametrize("seed", RNG_SEEDS)
@pytest.mark.parametrize("deviation", [0.05, 0.1, 0.3])
def test_noise_of_a_smooth_scene(seed: int, deviation: float) -> None:
    noise = np.random.default_rng(seed).standard_normal(SCENE.shape, dtype=np.float32)
    noisy = SCENE + np.float32(deviation) * noise
    assert noise_share(noisy) == pytest.approx(deviation, rel=0.25)


@pytest.mark.parametrize("seed", RNG_SEEDS)
def test_stripes_are_told_from_noise_and_from_the_other_direction(seed: int) -> None:
    rng = np.random.default_rng(seed)
    noise = np.float32(0.1) * rng.standard_normal(SCENE.shape, dtype=np.float32)
    columns = np.float32(0.1) * rng.standard_normal((1, SCENE.shape[1]), dtype=np.float32)
    striped = SCENE + noise + columns
    assert stripe_share(striped) == pytest.approx(0.08, abs=0.03)
    assert stripe_share(SCENE + noise) < 0.03
    assert stripe_share(np.ascontiguousarray(striped.T)) < 0.03


def test_drift_is_what_a_quadratic_surface_explains() -> None:
    rows, columns = np.mgrid[-1:1:77j, -1:1:96j]
    surface = (0.5 * columns - 0.3 * rows + 0.2 * rows * columns).astype(np.float32)
    noise = np.random.default_rng(0).standard_normal(surface.shape, dtype=np.float32)
    assert drift_share(surface + np.float32(0.2) * noise) == pytest.approx(surface.std(), rel=0.05)


def test_blur_makes_the_slope_steeper() -> None:
    white = [
        np.random.default_rng(seed).standard_normal((77, 96), dtype=np.float32)
        for seed in RNG_SEEDS
    ]
    slopes = [
        [spectral_slope(noise), *(spectral_slope(blur(noise, s)) for s in (0.7, 1.5))]
        for noise in white
    ]
    assert all(row == sorted(row, reverse=True) for row in slopes)
    assert np.mean([row[0] for row in slopes]) == pytest.approx(0, abs=0.2)


def test_clipping_is_what_lies_at_both_ends() -> None:
    values = np.linspace(0, 1, 101, dtype=np.float32)[None]
    assert clipped_share(values) == pytest.approx(2 / 101)
    assert clipped_share(np.clip(values, 0.1, 0.8)) == pytest.approx((11 + 21) / 101)
