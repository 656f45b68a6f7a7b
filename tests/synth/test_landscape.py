"""Landscapes: every kind has texture in both views, seeds differ, nothing depends on chance."""

import numpy as np
import pytest

from uasthn_cli.synth.kinds import LandscapeKind
from uasthn_cli.synth.landscape import Landscape, render_landscape
from uasthn_cli.synth.materials import Climate, Material
from uasthn_cli.synth.recipes import build_scene
from uasthn_cli.synth.scene import Date, new_scene

SIZE_PX = (220, 160)
GSD_M = 1.5

KINDS = pytest.mark.parametrize("kind", list(LandscapeKind))


def rendered(seed: int, kind: LandscapeKind | None = None) -> Landscape:
    return render_landscape(seed, SIZE_PX, GSD_M, kind=kind)


def explained_by_colour(place: Landscape) -> float:
    """Return the share of the temperature's variance that the colour of the pixel explains."""
    codes = (place.rgb // 24).astype(np.int64) @ np.array([121, 11, 1])
    _, group = np.unique(codes, return_inverse=True)
    temperature = place.temperature.ravel().astype(np.float64)
    sums = np.bincount(group.ravel(), weights=temperature)
    means = sums / np.bincount(group.ravel())
    return float(1.0 - np.var(temperature - means[group.ravel()]) / np.var(temperature))


@KINDS
def test_convention_size_is_width_by_height(kind: LandscapeKind) -> None:
    place = rendered(3, kind)
    assert place.rgb.shape == (160, 220, 3)
    assert place.rgb.dtype == np.uint8
    assert place.temperature.shape == place.height_m.shape == place.material.shape == (160, 220)
    assert place.temperature.dtype == place.height_m.dtype == np.float32
    assert place.gsd_m == GSD_M


@KINDS
def test_same_seed_same_bytes(kind: LandscapeKind) -> None:
    first, second = rendered(11, kind), rendered(11, kind)
    assert first.rgb.tobytes() == second.rgb.tobytes()
    assert first.temperature.tobytes() == second.temperature.tobytes()


@KINDS
def test_seeds_differ(kind: LandscapeKind) -> None:
    first, second = rendered(1, kind), rendered(2, kind)
    likeness = np.corrcoef(first.temperature.ravel(), second.temperature.ravel())[0, 1]
    assert abs(likeness) < 0.6
    assert np.mean(first.rgb == second.rgb) < 0.2


@KINDS
@pytest.mark.parametrize("seed", [5, 6])
def test_both_views_have_texture_everywhere(kind: LandscapeKind, seed: int) -> None:
    place = rendered(seed, kind)
    assert np.isfinite(place.temperature).all()
    for rows in (slice(0, 80), slice(80, 160)):
        for columns in (slice(0, 110), slice(110, 220)):
            assert place.rgb[rows, columns].mean(axis=-1).std() > 1.5
            assert place.temperature[rows, columns].std() > 0.05


@KINDS
def test_temperature_is_no_function_of_the_colour(kind: LandscapeKind) -> None:
    shares = [explained_by_colour(rendered(seed, kind)) for seed in range(3)]
    assert np.mean(shares) < 0.9


def test_kind_is_drawn_from_the_seed_when_not_given() -> None:
    palettes = {int(np.bincount(rendered(seed).material.ravel()).argmax()) for seed in range(12)}
    assert len(palettes) > 2


@pytest.mark.parametrize(("size_px", "gsd_m"), [((0, 50), 1.0), ((50, 50), 0.0), ((50, 8), 1.0)])
def test_impossible_sizes_are_refused(size_px: tuple[int, int], gsd_m: float) -> None:
    with pytest.raises(ValueError, match="cannot render"):
        render_landscape(0, size_px, gsd_m)


@pytest.mark.parametrize("seed", [4, 5])
def test_some_fields_change_between_the_dates(seed: int) -> None:
    scene = build_scene(np.random.default_rng(seed), (300, 420), 1.0, LandscapeKind.FARMS)
    assert 0.005 < float(np.mean(scene.day != scene.night)) < 0.5


def test_materials_are_those_of_the_date() -> None:
    scene = new_scene(np.random.default_rng(0), (30, 50), 1.0, Climate.ARID)
    scene.new_patch(Material.SAND)
    track = scene.new_overlay(Material.TRACK)
    track.night[4, 40] = 255
    assert scene.materials(Date.DAY)[4, 40] == Material.SAND
    assert scene.materials(Date.NIGHT)[4, 40] == Material.TRACK


def test_convention_fill_takes_x_then_y() -> None:
    scene = new_scene(np.random.default_rng(0), (30, 50), 1.0, Climate.ARID)
    scene.new_patch(Material.SAND)
    patch = scene.new_patch(Material.WATER)
    scene.fill(np.array([[40.0, 10.0], [45.0, 10.0], [45.0, 12.0], [40.0, 12.0]]), patch, Date.DAY)
    rows, columns = np.nonzero(scene.day == patch)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (10, 12, 40, 45)
    assert not scene.night.any()
