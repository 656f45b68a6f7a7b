"""Pseudo-thermal renderings: aligned with the colour image, another look each time."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_training import pattern

from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.pseudo_thermal import thermal_from_colour
from uasthn_cli.training.sand import SandScene, render_sand, thermal_from_sand

ALL = EngineConfig()
RGB = np.stack([pattern(seed, 96, 128) for seed in (1, 2, 3)], axis=-1)


def test_renderings_are_standardised_images_of_the_same_size() -> None:
    for seed in range(10):
        thermal = thermal_from_colour(np.random.default_rng(seed), RGB, ALL)
        assert thermal.shape == RGB.shape[:2]
        assert thermal.dtype == np.float32
        assert abs(float(thermal.mean())) < 1e-3
        assert float(thermal.std()) == pytest.approx(1, abs=0.01)


def test_every_draw_looks_different_and_the_sign_is_free() -> None:
    looks = [
        thermal_from_colour(np.random.default_rng(seed), RGB, ALL).ravel() for seed in range(12)
    ]
    correlations = np.asarray(np.corrcoef(looks))[np.triu_indices(12, 1)]
    assert correlations.max() < 0.999
    assert correlations.min() < -0.2 < 0.2 < correlations.max()


def test_the_same_generator_renders_alike() -> None:
    first, second = (thermal_from_colour(np.random.default_rng(4), RGB, ALL) for _ in range(2))
    assert np.array_equal(first, second)


def test_an_image_of_one_colour_renders_without_a_fault() -> None:
    for seed in range(10):
        flat = np.full((64, 80, 3), 0.4, np.float32)
        assert np.isfinite(thermal_from_colour(np.random.default_rng(seed), flat, ALL)).all()


def test_structure_stays_where_it_is() -> None:
    half = np.zeros((64, 96, 3), np.float32)
    half[:, 48:] = (0.8, 0.5, 0.3)
    steps = [
        int(
            np.abs(
                np.diff(thermal_from_colour(np.random.default_rng(seed), half, ALL)[32])
            ).argmax()
        )
        for seed in range(20)
    ]
    assert np.median(steps) == 47
    assert max(abs(step - 47) for step in steps) <= 3


PLAIN = EngineConfig(tone_curves=False, cluster_temperatures=False, texture=False, relief=False)


def test_without_any_part_a_projection_of_the_colours_is_left() -> None:
    colours = np.column_stack([RGB.reshape(-1, 3), np.ones(RGB[..., 0].size)])
    for seed in range(10):
        view = thermal_from_colour(np.random.default_rng(seed), RGB, PLAIN).ravel()
        fitted = colours @ np.linalg.lstsq(colours, view, rcond=None)[0]
        assert np.abs(view - fitted).max() < 0.05, "one of 256 steps"


@pytest.mark.parametrize("part", ["tone_curves", "cluster_temperatures", "texture", "relief"])
def test_every_part_changes_some_renderings(part: str) -> None:
    changed = [
        not np.allclose(
            thermal_from_colour(np.random.default_rng(seed), RGB, replace(PLAIN, **{part: True})),
            thermal_from_colour(np.random.default_rng(seed), RGB, PLAIN),
            atol=0.05,
        )
        for seed in range(12)
    ]
    assert any(changed)


@pytest.fixture(scope="module")
def sand() -> SandScene:
    return render_sand(np.random.default_rng(5), 192)


def test_sand_is_a_colour_image_over_a_relief(sand: SandScene) -> None:
    assert sand.rgb.shape == (192, 192, 3)
    assert sand.rgb.min() >= 0
    assert sand.rgb.max() <= 1
    assert float(sand.height.std()) == pytest.approx(1, abs=0.01)
    again = render_sand(np.random.default_rng(5), 192)
    assert np.array_equal(sand.rgb, again.rgb)
    assert np.array_equal(sand.material, again.material)


def test_night_views_of_sand_differ_and_leave_it_as_it_is(sand: SandScene) -> None:
    before = sand.height.copy()
    views = [thermal_from_sand(np.random.default_rng(seed), sand, ALL) for seed in range(4)]
    assert all(view.shape == (192, 192) and np.isfinite(view).all() for view in views)
    assert not np.allclose(views[0], views[1])
    assert np.array_equal(sand.height, before)
