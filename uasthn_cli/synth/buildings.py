"""Buildings with roofs, yards and parked vehicles; farmsteads, villages, street grids."""

import math
from dataclasses import dataclass

import numpy as np

from uasthn_cli.synth.cover import ragged_fill, thin_patch
from uasthn_cli.synth.layout import Axes, Plot, divide
from uasthn_cli.synth.materials import Climate, Material
from uasthn_cli.synth.roads import ground_overlay
from uasthn_cli.synth.scene import Date, Patch, Scene, draw_lines, fill_ring
from uasthn_cli.synth.vegetation import plant
from uasthn_cli.types import FloatArray

_ONLY_ONCE = 0.05


@dataclass(frozen=True, slots=True)
class Roofs:
    """Patches to roof with: pairs of a sunny and a shady half, and vehicle paints."""

    halves: tuple[tuple[int, int], ...]
    vehicles: tuple[int, ...]


def draw_roofs(scene: Scene, kinds: int = 14) -> Roofs:
    """Draw the roofs of one landscape."""
    halves = []
    for _ in range(kinds):
        sunny = scene.patches[scene.new_patch(Material.ROOF, mottle=0.04)]
        shade = 1.0 if scene.climate is Climate.ARID else float(scene.rng.uniform(0.72, 0.95))
        r, g, b = (channel * shade for channel in sunny.colour)
        dim = Patch(Material.ROOF, (r, g, b), sunny.warmth_k + 0.3, sunny.mottle)
        halves.append((len(scene.patches) - 1, scene.add_patch(dim)))
    vehicles = tuple(scene.new_patch(Material.VEHICLE, mottle=0.0) for _ in range(6))
    return Roofs(tuple(halves), vehicles)


def building(scene: Scene, roofs: Roofs, axes: Axes, plot: Plot, height_m: float) -> None:
    """Put up one building: two roof halves, height for shadows, no road through it.

    One in twenty stands on one of the two dates only.
    """
    chance = scene.rng.random()
    date = Date.DAY if chance < _ONLY_ONCE else Date.NIGHT if chance > 1 - _ONLY_ONCE else Date.BOTH
    sunny, shady = roofs.halves[int(scene.rng.integers(len(roofs.halves)))]
    ring = axes.to_px(plot.corners_m())
    middle = 0.5 * (plot.u0_m + plot.u1_m)
    half = Plot(middle, plot.v0_m, plot.u1_m, plot.v1_m)
    scene.fill(ring, sunny, date)
    scene.fill(axes.to_px(half.corners_m()), shady, date)
    if date & Date.DAY:
        fill_ring(scene.above_m, ring, height_m)
    for overlay in scene.overlays:
        for coverage in overlay.layers(date):
            fill_ring(coverage, ring, 0)


def vehicle(
    scene: Scene, roofs: Roofs, axes: Axes, place_m: FloatArray, *, lengthwise: bool
) -> None:
    """Park one vehicle for one date: vehicles do not wait."""
    date = Date.DAY if scene.rng.random() < 0.5 else Date.NIGHT
    length_m, width_m = (4.6, 2.0) if lengthwise else (2.0, 4.6)
    plot = Plot(
        place_m[0] - length_m / 2,
        place_m[1] - width_m / 2,
        place_m[0] + length_m / 2,
        place_m[1] + width_m / 2,
    )
    paint = roofs.vehicles[int(scene.rng.integers(len(roofs.vehicles)))]
    scene.fill(axes.to_px(plot.corners_m()), paint, date)


def farmstead(scene: Scene, roofs: Roofs, axes: Axes, yard_patch: int) -> None:
    """Build a yard around the origin of the axes: sheds, a house, trees, vehicles."""
    size_m = float(scene.rng.uniform(25.0, 55.0))
    yard = axes.to_px(Plot(-size_m, -size_m, size_m, size_m).corners_m())
    ragged_fill(scene, yard, yard_patch, 0.25 * size_m)
    for lot in divide(scene.rng, Plot(-size_m, -size_m, size_m, size_m), 0.8 * size_m, 12.0):
        if scene.rng.random() < 0.45:
            margin = float(scene.rng.uniform(1.5, 5.0))
            ring = lot.corners_m(margin)
            plot = Plot(ring[0, 0], ring[0, 1], ring[2, 0], ring[2, 1])
            building(scene, roofs, axes, plot, float(scene.rng.uniform(3.0, 8.0)))
        elif scene.rng.random() < 0.3:
            place = scene.rng.uniform((lot.u0_m, lot.v0_m), (lot.u1_m, lot.v1_m))
            vehicle(scene, roofs, axes, place, lengthwise=bool(scene.rng.random() < 0.5))
    count = int(scene.rng.integers(4, 22))
    trees = axes.to_px(scene.rng.normal(0.0, 0.8 * size_m, (count, 2)))
    radii_m = scene.rng.uniform(1.5, 4.5, count)
    plant(scene, Material.CROWN, trees, radii_m, height_per_radius=2.0)


def town(scene: Scene, roofs: Roofs, axes: Axes, area: Plot) -> None:
    """Build a street grid: blocks of houses with gardens, some with halls and car parks."""
    streets, trees = [], []
    width_m = float(scene.rng.uniform(6.0, 10.0))
    yards = [thin_patch(scene, m, 0.5) for m in (Material.GRASS, Material.GRASS, Material.SOIL)]
    lots = [scene.new_patch(Material.CONCRETE, mottle=0.05) for _ in range(2)]
    blocks = divide(scene.rng, area, 190.0, 70.0)
    for block in blocks:
        ring = block.corners_m()
        streets.append(axes.to_px(np.concatenate([ring, ring[:1]])))
        inner = block.corners_m(0.5 * width_m + 2.0)
        plot = Plot(inner[0, 0], inner[0, 1], inner[2, 0], inner[2, 1])
        if scene.rng.random() < 0.18:
            scene.fill(axes.to_px(inner), lots[int(scene.rng.integers(2))])
            _halls(scene, roofs, axes, plot)
        else:
            scene.fill(axes.to_px(inner), yards[int(scene.rng.integers(3))])
            trees.append(_houses(scene, roofs, axes, plot))
    paved = ground_overlay(scene, Material.PAVED)
    for coverage in (paved.day, paved.night):
        draw_lines(coverage, streets, width_m / scene.gsd_m)
    _plant_gardens(scene, trees)


def _houses(scene: Scene, roofs: Roofs, axes: Axes, block: Plot) -> FloatArray:
    """Fill a block with houses in lots; return the places of its garden trees in pixels."""
    lot_m = float(scene.rng.uniform(15.0, 26.0))
    rows, columns = (
        max(1, round(block.length_m / (1.5 * lot_m))),
        max(1, round(block.width_m / lot_m)),
    )
    u = np.linspace(block.u0_m, block.u1_m, columns + 1)
    v = np.linspace(block.v0_m, block.v1_m, rows + 1)
    for i in range(columns):
        for j in range(rows):
            if scene.rng.random() < 0.12:
                continue
            side = 0.5 * (v[j + 1] - v[j])
            depth = min(side, float(scene.rng.uniform(8.0, 15.0)))
            margin = 0.18 * (u[i + 1] - u[i])
            v0 = v[j] + float(scene.rng.uniform(0.1, 0.5)) * (v[j + 1] - v[j] - depth)
            house = Plot(u[i] + margin, v0, u[i + 1] - margin, v0 + depth)
            building(scene, roofs, axes, house, float(scene.rng.uniform(3.5, 8.0)))
            if scene.rng.random() < 0.25:
                place = np.array([u[i] + 0.5 * margin, v0 + 0.5 * depth])
                vehicle(scene, roofs, axes, place, lengthwise=False)
    count = scene.rng.poisson(0.0022 * block.width_m * block.length_m)
    places = scene.rng.uniform((block.u0_m, block.v0_m), (block.u1_m, block.v1_m), (count, 2))
    return axes.to_px(places)


def _halls(scene: Scene, roofs: Roofs, axes: Axes, block: Plot) -> None:
    """Put one to three halls on a block and park vehicles in rows on the rest."""
    for lot in divide(scene.rng, block, 90.0, 35.0):
        if scene.rng.random() < 0.6:
            ring = lot.corners_m(float(scene.rng.uniform(3.0, 10.0)))
            hall = Plot(ring[0, 0], ring[0, 1], ring[2, 0], ring[2, 1])
            building(scene, roofs, axes, hall, float(scene.rng.uniform(6.0, 14.0)))
            continue
        for v in np.arange(lot.v0_m + 5.0, lot.v1_m - 4.0, 11.0):
            for u in np.arange(lot.u0_m + 3.0, lot.u1_m - 2.0, 2.8):
                if scene.rng.random() < 0.4:
                    vehicle(scene, roofs, axes, np.array([u, v]), lengthwise=False)


def _plant_gardens(scene: Scene, groups: list[FloatArray]) -> None:
    """Plant the gardens' trees."""
    if groups:
        points = np.concatenate(groups)
        radii_m = scene.rng.uniform(1.5, 4.5, len(points))
        plant(scene, Material.CROWN, points, radii_m, height_per_radius=2.0)


def random_axes(scene: Scene, angle_rad: float | None = None) -> Axes:
    """Return axes at a random place of the scene, turned at random unless told."""
    height, width = scene.shape
    place = scene.rng.uniform((0.08, 0.08), (0.92, 0.92)) * (width, height)
    angle = float(scene.rng.uniform(0.0, math.pi)) if angle_rad is None else angle_rad
    return Axes((float(place[0]), float(place[1])), angle, scene.gsd_m)
