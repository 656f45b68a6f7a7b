"""Fields: patchworks of crops, irrigation circles, walled desert plots with palms."""

import math

import numpy as np

from uasthn_cli.synth.cover import ragged_fill
from uasthn_cli.synth.layout import Axes, Plot, divide
from uasthn_cli.synth.materials import Climate, Material
from uasthn_cli.synth.roads import ground_overlay
from uasthn_cli.synth.scene import Date, Scene, draw_lines
from uasthn_cli.synth.vegetation import hedge_points, orchard_points, plant
from uasthn_cli.types import BoolArray, FloatArray

_RECROPPED = 0.25
_SPACINGS_M = (3.0, 6.0, 9.0, 12.0, 18.0, 24.0)


def new_field(scene: Scene, angle_rad: float) -> int:
    """Add the patch of one field: a crop, stubble, bare soil or grass, with rows."""
    materials = (Material.CROP, Material.STUBBLE, Material.SOIL, Material.GRASS)
    shares = (0.45, 0.2, 0.2, 0.15)
    material = materials[int(scene.rng.choice(4, p=shares))]
    turned = angle_rad + (0.5 * math.pi if scene.rng.random() < 0.4 else 0.0)
    return scene.new_patch(
        material,
        mottle=float(scene.rng.uniform(0.03, 0.10)),
        row_angle_rad=turned,
        row_spacing_m=float(scene.rng.choice(_SPACINGS_M)) * float(scene.rng.uniform(0.9, 1.1)),
        row_contrast=float(scene.rng.exponential(0.035)),
    )


def patchwork(scene: Scene, axes: Axes, area: Plot, largest_m: float, mask: BoolArray) -> None:
    """Cover an area with fields where the mask is true; a quarter were re-cropped at night."""
    fields = divide(scene.rng, area, largest_m, 0.25 * largest_m)
    keep = [np.copy(raster) for raster in (scene.day, scene.night)]
    lanes: list[FloatArray] = []
    hedges: list[FloatArray] = []
    for plot in fields:
        _sow(scene, axes, plot)
        ring = axes.to_px(plot.corners_m())
        edge = np.stack([ring[0], ring[1]]) if scene.rng.random() < 0.5 else ring[1:3]
        fate = scene.rng.random()
        if fate < 0.25:
            lanes.append(edge)
        elif fate < 0.45:
            hedges.append(edge)
    for raster, before in zip((scene.day, scene.night), keep, strict=True):
        raster[~mask] = before[~mask]
    _edge_lanes(scene, lanes, mask)
    _plant_hedges(scene, hedges, mask)


def pivots(scene: Scene, axes: Axes, area: Plot, radius_m: float, mask: BoolArray) -> None:
    """Lay irrigation circles in a square grid, some of them cut by a sector of another crop."""
    keep = [np.copy(raster) for raster in (scene.day, scene.night)]
    step = 2.0 * radius_m
    for u in np.arange(area.u0_m + radius_m, area.u1_m, step):
        for v in np.arange(area.v0_m + radius_m, area.v1_m, step):
            _sow(scene, axes, Plot(u - radius_m, v - radius_m, u + radius_m, v + radius_m))
            if scene.rng.random() < 0.85:
                _pivot(scene, axes, np.array([u, v]), 0.97 * radius_m)
    for raster, before in zip((scene.day, scene.night), keep, strict=True):
        raster[~mask] = before[~mask]


def desert_farm(scene: Scene, axes: Axes, area: Plot) -> None:
    """Wall off a rectangle in the sand: beds, date palms in a grid, a windbreak around."""
    ground = scene.new_patch(Material.SOIL, mottle=0.07)
    ragged_fill(scene, axes.to_px(area.corners_m()), ground, 3.0)
    palms: list[FloatArray] = []
    for plot in divide(scene.rng, area, 75.0, 22.0):
        fate = scene.rng.random()
        ring = axes.to_px(plot.corners_m(float(scene.rng.uniform(1.0, 3.0))))
        if fate < 0.40:
            _bed(scene, ring, axes.angle_rad)
        if 0.25 < fate < 0.75:
            palms.append(orchard_points(scene, axes, plot, float(scene.rng.uniform(5.0, 9.0))))
    ring = axes.to_px(area.corners_m())
    ring = np.concatenate([ring, ring[:1]])
    track = ground_overlay(scene, Material.TRACK)
    for coverage in (track.day, track.night):
        draw_lines(coverage, [ring], float(scene.rng.uniform(2.0, 5.0)) / scene.gsd_m, 0.8)
    if scene.rng.random() < 0.7:
        inner = axes.to_px(area.corners_m(6.0))
        palms.append(hedge_points(scene, np.concatenate([inner, inner[:1]]), 3.0))
    if palms:
        points = np.concatenate(palms)
        radii_m = scene.rng.uniform(1.4, 3.0, len(points))
        plant(scene, Material.CROWN, points, radii_m, height_per_radius=2.0)


def _bed(scene: Scene, ring_px: FloatArray, angle_rad: float) -> None:
    """Sow one irrigated bed, fallow on one of the dates now and then."""
    bed = scene.new_patch(
        Material.CROP,
        mottle=0.08,
        row_angle_rad=angle_rad,
        row_spacing_m=float(scene.rng.uniform(2.5, 6.0)),
        row_contrast=float(scene.rng.uniform(0.0, 0.12)),
    )
    chance = scene.rng.random()
    scene.fill(
        ring_px, bed, Date.DAY if chance < 0.1 else Date.NIGHT if chance < 0.2 else Date.BOTH
    )


def _sow(scene: Scene, axes: Axes, plot: Plot) -> None:
    """Fill one field; on the night it may hold another crop, or be half harvested."""
    ring = axes.to_px(plot.corners_m(0.5 * scene.gsd_m))
    scene.fill(ring, new_field(scene, axes.angle_rad))
    if scene.rng.random() < _RECROPPED:
        changed = ring
        if scene.rng.random() < 0.4:
            share = float(scene.rng.uniform(0.3, 0.7))
            u = plot.u0_m + share * plot.width_m
            changed = axes.to_px(Plot(plot.u0_m, plot.v0_m, u, plot.v1_m).corners_m())
        scene.fill(changed, new_field(scene, axes.angle_rad), Date.NIGHT)


def _pivot(scene: Scene, axes: Axes, centre_m: FloatArray, radius_m: float) -> None:
    """Fill one irrigation circle and perhaps a sector of it."""
    turns = np.linspace(0.0, 2.0 * math.pi, 96, endpoint=False)
    ring = centre_m + radius_m * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    scene.fill(axes.to_px(ring), new_field(scene, axes.angle_rad))
    if scene.rng.random() < 0.6:
        first = scene.rng.uniform(0.0, 2.0 * math.pi)
        arc = np.linspace(first, first + scene.rng.uniform(0.4, 3.5), 64)
        sector = centre_m + radius_m * np.stack([np.cos(arc), np.sin(arc)], axis=1)
        date = Date.BOTH if scene.rng.random() < 0.6 else Date.NIGHT
        wedge = axes.to_px(np.concatenate([centre_m[None], sector]))
        scene.fill(wedge, new_field(scene, axes.angle_rad), date)


def _edge_lanes(scene: Scene, lanes: list[FloatArray], mask: BoolArray) -> None:
    """Draw farm lanes along some field edges."""
    if not lanes:
        return
    track = ground_overlay(scene, Material.TRACK)
    lane = np.zeros(scene.shape, dtype=np.uint8)
    draw_lines(lane, lanes, float(scene.rng.uniform(2.5, 5.0)) / scene.gsd_m, 0.8)
    lane[~mask] = 0
    for coverage in (track.day, track.night):
        np.maximum(coverage, lane, out=coverage)


def _plant_hedges(scene: Scene, hedges: list[FloatArray], mask: BoolArray) -> None:
    """Plant hedges along some field edges."""
    if not hedges or scene.climate is Climate.ARID:
        return
    points = np.concatenate([hedge_points(scene, line, 3.0) for line in hedges])
    limits = np.array(scene.shape[::-1]) - 1
    columns, rows = np.clip(np.round(points).astype(int), 0, limits).T
    points = points[mask[rows, columns]]
    radii_m = scene.rng.uniform(1.2, 3.5, len(points))
    plant(scene, Material.CROWN, points, radii_m, height_per_radius=2.2)
