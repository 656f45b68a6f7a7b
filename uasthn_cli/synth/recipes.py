"""Which things make up a town, a farmland, a forest, a desert."""

import math
from collections.abc import Callable

import numpy as np

from uasthn_cli.synth.buildings import Roofs, draw_roofs, farmstead, random_axes, town
from uasthn_cli.synth.cover import lakes, level_ground, open_ground, ragged_mask
from uasthn_cli.synth.dunes import dune_field
from uasthn_cli.synth.farmland import desert_farm, patchwork, pivots
from uasthn_cli.synth.kinds import LandscapeKind
from uasthn_cli.synth.layout import Axes, Plot
from uasthn_cli.synth.materials import Climate, Material
from uasthn_cli.synth.roads import crossing_roads, ground_overlay, wandering_tracks
from uasthn_cli.synth.scene import Scene, fill_ring, new_scene
from uasthn_cli.synth.terrain import hills
from uasthn_cli.synth.vegetation import forest, grow, scrub
from uasthn_cli.types import BoolArray


def build_scene(
    rng: np.random.Generator, shape: tuple[int, int], gsd_m: float, kind: LandscapeKind
) -> Scene:
    """Return a finished scene ``(h, w)`` of a kind."""
    climate = _draw_climate(rng, kind)
    scene = new_scene(rng, shape, gsd_m, climate)
    scene.ground_m += hills(
        rng,
        shape,
        gsd_m,
        wavelength_m=float(rng.uniform(400.0, 1500.0)),
        relief_m=float(rng.uniform(1.5, 9.0)),
    )
    _RECIPES[kind](scene)
    grow(scene)
    return scene


def _draw_climate(rng: np.random.Generator, kind: LandscapeKind) -> Climate:
    """Draw the climate: dunes are arid, forests are not, the rest is either."""
    chance = rng.random()
    if kind is LandscapeKind.DUNES:
        return Climate.ARID
    if kind is LandscapeKind.FOREST:
        return Climate.TEMPERATE
    return Climate.ARID if chance < 0.4 else Climate.TEMPERATE


def _dunes(scene: Scene) -> None:
    """Dunes with scrub, tracks, a few walled farms and huts."""
    rng = scene.rng
    _raise_dunes(scene, float(rng.uniform(0.6, 1.3)))
    open_ground(scene)
    scrub(scene, ragged_mask(scene, 0.7, 400.0), float(rng.choice([2.0, 8.0, 25.0])))
    tracks = ground_overlay(scene, Material.TRACK)
    wandering_tracks(scene, tracks, _count(scene, 1.5), 0.5)
    _desert_farms(scene, _count(scene, 1.2))


def _farms(scene: Scene) -> None:
    """A patchwork of fields or irrigation circles with farmsteads; desert plots where arid."""
    rng = scene.rng
    if scene.climate is Climate.ARID and rng.random() < 0.5:
        _raise_dunes(scene, float(rng.uniform(0.2, 0.8)))
        open_ground(scene)
        scrub(scene, ragged_mask(scene, 0.6, 300.0), float(rng.uniform(2.0, 25.0)))
        wandering_tracks(scene, ground_overlay(scene, Material.TRACK), _count(scene, 1.5), 0.4)
        _desert_farms(scene, 1 + _count(scene, 4.0))
        return
    open_ground(scene)
    _fields(scene, float(rng.uniform(0.75, 1.0)))
    wood, water = float(rng.choice([0.0, 0.06])), float(rng.choice([0.0, 0.05]))
    wet = _woods_and_water(scene, wood=wood, water=water)
    _rural_roads(scene)
    _dry(scene, wet)
    _farmsteads(scene, draw_roofs(scene), 1 + _count(scene, 2.0))


def _town(scene: Scene) -> None:
    """A street grid with a ragged edge of fields or desert."""
    rng = scene.rng
    open_ground(scene)
    _fields(scene, 0.4)
    wet = _woods_and_water(scene, wood=0.05, water=float(rng.choice([0.0, 0.04])))
    _dry(scene, wet)
    crossing_roads(scene, 1 + int(rng.integers(2)))
    reach_m = 0.5 * max(scene.extent_m) * float(rng.uniform(0.6, 1.2))
    reach_m = min(reach_m, 900.0)
    axes = random_axes(scene)
    town(scene, draw_roofs(scene), axes, Plot(-reach_m, -0.8 * reach_m, reach_m, 0.8 * reach_m))


def _forest(scene: Scene) -> None:
    """Woods of single crowns with clearings, forest roads, ponds and a hut."""
    rng = scene.rng
    open_ground(scene)
    wet = _woods_and_water(
        scene, wood=float(rng.uniform(0.5, 0.9)), water=float(rng.choice([0.0, 0.06]))
    )
    tracks = ground_overlay(scene, Material.TRACK)
    wandering_tracks(scene, tracks, 1 + _count(scene, 2.0), 0.6)
    _dry(scene, wet)
    _farmsteads(scene, draw_roofs(scene), _count(scene, 0.7))


def _mixed(scene: Scene) -> None:
    """Some of everything: fields, woods, water, a village, roads; dunes where arid."""
    rng = scene.rng
    if scene.climate is Climate.ARID:
        _raise_dunes(scene, float(rng.uniform(0.1, 0.9)))
    open_ground(scene)
    _fields(scene, float(rng.uniform(0.25, 0.6)))
    arid = scene.climate is Climate.ARID
    wood = 0.02 if arid else float(rng.uniform(0.1, 0.3))
    wet = _woods_and_water(scene, wood=wood, water=0.0 if arid else float(rng.uniform(0.0, 0.08)))
    if arid:
        scrub(scene, ragged_mask(scene, 0.5, 300.0), float(rng.uniform(2.0, 20.0)))
        _desert_farms(scene, _count(scene, 2.0))
    _rural_roads(scene)
    _dry(scene, wet)
    roofs = draw_roofs(scene)
    _farmsteads(scene, roofs, _count(scene, 1.5))
    if rng.random() < 0.6:
        size_m = float(rng.uniform(90.0, 260.0))
        town(scene, roofs, random_axes(scene), Plot(-size_m, -0.6 * size_m, size_m, 0.6 * size_m))


def _raise_dunes(scene: Scene, share: float) -> None:
    """Raise dunes over the scene, lower on the parts beyond ``share``."""
    spacing_m = float(np.exp(scene.rng.uniform(math.log(45.0), math.log(220.0))))
    spacing_m = max(spacing_m, 5.0 * scene.gsd_m)
    wind_rad = float(scene.rng.uniform(0.0, 2.0 * math.pi))
    dunes = dune_field(scene.rng, scene.shape, scene.gsd_m, spacing_m=spacing_m, wind_rad=wind_rad)
    scene.ground_m += min(share, 1.0) * dunes


def _fields(scene: Scene, share: float) -> None:
    """Lay a patchwork or circles over a ragged share of the scene."""
    rng = scene.rng
    reach_m = 0.75 * math.hypot(*scene.extent_m)
    height, width = scene.shape
    axes = Axes((0.5 * width, 0.5 * height), float(rng.uniform(0.0, math.pi)), scene.gsd_m)
    if rng.random() < 0.4:
        axes = Axes(axes.origin_px, float(rng.normal(0.0, 0.02)), scene.gsd_m)
    area = Plot(-reach_m, -reach_m, reach_m, reach_m)
    mask = ragged_mask(scene, share, 700.0)
    if rng.random() < 0.25:
        radius_m = float(rng.choice([100.0, 200.0, 400.0]))
        pivots(scene, axes, area, max(radius_m, 12.0 * scene.gsd_m), mask)
    else:
        largest_m = float(np.exp(rng.uniform(math.log(90.0), math.log(500.0))))
        patchwork(scene, axes, area, max(largest_m, 24.0 * scene.gsd_m), mask)
    level_ground(scene, mask)


def _woods_and_water(scene: Scene, *, wood: float, water: float) -> BoolArray:
    """Flood the lowest ground, then plant woods on dry land; return the water."""
    wet = lakes(scene, water) if water > 0.0 else np.zeros(scene.shape, dtype=np.bool_)
    if wood > 0.0:
        spacing_m = float(scene.rng.uniform(4.5, 8.0))
        mask = ragged_mask(scene, wood, float(scene.rng.uniform(200.0, 600.0))) & ~wet
        litter = scene.new_patch(Material.GRASS, mottle=0.09)
        scene.paint(mask, litter)
        forest(scene, mask, spacing_m)
    return wet


def _rural_roads(scene: Scene) -> None:
    """Draw a paved road or two and some tracks."""
    crossing_roads(scene, int(scene.rng.integers(0, 3)))
    tracks = ground_overlay(scene, Material.TRACK)
    wandering_tracks(scene, tracks, _count(scene, 1.5), 0.25)


def _desert_farms(scene: Scene, count: int) -> None:
    """Set walled farms into the sand, flattening it, with sheds beside them."""
    roofs = draw_roofs(scene, kinds=8)
    angle_rad = float(scene.rng.uniform(0.0, math.pi))
    walled = np.zeros(scene.shape, dtype=np.uint8)
    for _ in range(count):
        axes = random_axes(scene, angle_rad + float(scene.rng.normal(0.0, 0.08)))
        half = scene.rng.uniform(35.0, 130.0, 2)
        area = Plot(-half[0], -half[1], half[0], half[1])
        desert_farm(scene, axes, area)
        fill_ring(walled, axes.to_px(area.corners_m()), 1)
        beside = axes.to_px(np.array([half[0] + 40.0, scene.rng.uniform(-half[1], half[1])]))
        yard = Axes((float(beside[0]), float(beside[1])), axes.angle_rad, scene.gsd_m)
        if scene.rng.random() < 0.6:
            farmstead(scene, roofs, yard, scene.new_patch(Material.SAND, mottle=0.06))
    level_ground(scene, walled > 0)


def _farmsteads(scene: Scene, roofs: Roofs, count: int) -> None:
    """Build farmsteads at random places."""
    for _ in range(count):
        farmstead(scene, roofs, random_axes(scene), scene.new_patch(Material.SOIL, mottle=0.09))


def _dry(scene: Scene, wet: BoolArray) -> None:
    """Take tracks off the water."""
    for overlay in scene.overlays:
        if overlay.material is Material.TRACK:
            overlay.day[wet] = 0
            overlay.night[wet] = 0


def _count(scene: Scene, per_square_km: float) -> int:
    """Draw how many things of a density there are in the scene (at least a third of a km²)."""
    width_m, height_m = scene.extent_m
    area_km2 = float(np.clip(width_m * height_m / 1e6, 0.35, 12.0))
    return int(scene.rng.poisson(per_square_km * area_km2))


_RECIPES: dict[LandscapeKind, Callable[[Scene], None]] = {
    LandscapeKind.DUNES: _dunes,
    LandscapeKind.FARMS: _farms,
    LandscapeKind.TOWN: _town,
    LandscapeKind.FOREST: _forest,
    LandscapeKind.MIXED: _mixed,
}
