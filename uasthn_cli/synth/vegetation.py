"""Plants that stand alone: forest crowns, orchards, hedges and scrub dots."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.synth.layout import Axes, Plot
from uasthn_cli.synth.materials import Material
from uasthn_cli.synth.noise import fractal_noise
from uasthn_cli.synth.scene import Overlay, Planting, Scene
from uasthn_cli.types import BoolArray, FloatArray, ImageArray

_RADIUS_CLASSES = 5


def forest(scene: Scene, mask: BoolArray, spacing_m: float) -> None:
    """Fill a mask with crowns about ``spacing_m`` apart, with glades and edges left open."""
    density = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 90.0, finest_m=6.0)
    points = _jittered_grid(scene, spacing_m)
    keep = _values_at(density, points) > scene.rng.normal(-1.5, 0.5, len(points))
    points = points[keep & (_values_at(mask.astype(np.float32), points) > 0.5)]
    radii_m = 0.68 * spacing_m * scene.rng.lognormal(0.0, 0.28, len(points))
    plant(scene, Material.CROWN, points, radii_m, height_per_radius=3.2)


def scrub(scene: Scene, mask: BoolArray, per_hectare: float) -> None:
    """Scatter shrubs over a mask in loose groups."""
    groups = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 120.0, roughness=0.65)
    width_m, height_m = scene.extent_m
    count = int(min(per_hectare * width_m * height_m / 1e4, 60_000))
    points = scene.rng.uniform((0, 0), scene.shape[::-1], (3 * count, 2))
    liking = np.exp(1.3 * _values_at(groups, points)) * _values_at(mask.astype(np.float32), points)
    points = points[scene.rng.uniform(0.0, 6.0, len(points)) < liking]
    radii_m = np.clip(scene.rng.lognormal(math.log(1.1), 0.45, len(points)), 0.5, 4.0)
    plant(scene, Material.SCRUB, points, radii_m, height_per_radius=1.2)


def orchard_points(scene: Scene, axes: Axes, plot: Plot, spacing_m: float) -> FloatArray:
    """Return the trees ``(n, 2)`` of a planted plot in pixels, a few missing."""
    u = np.arange(plot.u0_m + 0.6 * spacing_m, plot.u1_m - 0.3 * spacing_m, spacing_m)
    v = np.arange(plot.v0_m + 0.6 * spacing_m, plot.v1_m - 0.3 * spacing_m, spacing_m)
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    grid = grid[scene.rng.random(len(grid)) > scene.rng.uniform(0.02, 0.3)]
    return axes.to_px(grid + scene.rng.normal(0.0, 0.06 * spacing_m, grid.shape))


def hedge_points(scene: Scene, line_px: FloatArray, spacing_m: float) -> FloatArray:
    """Return trees ``(n, 2)`` in pixels along a line, with gaps."""
    lengths = np.linalg.norm(np.diff(line_px, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    count = int(along[-1] * scene.gsd_m / spacing_m)
    places = np.sort(scene.rng.uniform(0.0, along[-1], count))
    points = np.stack([np.interp(places, along, line_px[:, axis]) for axis in (0, 1)], axis=1)
    gaps = np.sin(places * scene.gsd_m / scene.rng.uniform(8.0, 30.0))
    points = points[gaps > scene.rng.uniform(-1.0, 0.0)]
    return points + scene.rng.normal(0.0, 0.5 / scene.gsd_m, points.shape)


def plant(
    scene: Scene,
    material: Material,
    points_px: FloatArray,
    radii_m: FloatArray,
    *,
    height_per_radius: float,
) -> None:
    """Mark plants with crowns of the radii given; :func:`grow` draws them all at once."""
    scene.plantings.append(Planting(material, points_px, radii_m, height_per_radius))


def grow(scene: Scene) -> None:
    """Draw every plant that was set: coverage on both dates, height by day; none on a roof.

    Crowns are domes whose outline and height a fine noise frays.
    """
    fray = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 4.0, roughness=0.7)
    for material in (Material.SCRUB, Material.CROWN):
        plantings = [p for p in scene.plantings if p.material is material]
        if not plantings:
            continue
        points = np.concatenate([p.points_px for p in plantings])
        radii_m = np.concatenate([p.radii_m for p in plantings])
        growth = np.concatenate([np.full(len(p.radii_m), p.height_per_radius) for p in plantings])
        inside = ((points >= -0.5) & (points < np.array(scene.shape[::-1]) - 0.5)).all(axis=1)
        inside &= _values_at(scene.above_m, points) == 0.0
        overlay = scene.new_overlay(material)
        _draw(scene, overlay, points[inside], radii_m[inside], fray, growth[inside])
    _fell(scene)


def _draw(
    scene: Scene,
    overlay: Overlay,
    points_px: FloatArray,
    radii_m: FloatArray,
    fray: ImageArray,
    growth: FloatArray,
) -> None:
    """Draw the plants of one kind, size class by size class."""
    crown_m = np.zeros(scene.shape, dtype=np.float32)
    cover = np.zeros(scene.shape, dtype=np.float32)
    for group in _by_size(radii_m):
        radius_m = float(radii_m[group].mean())
        disc, dome = _stamped(scene.shape, points_px[group], radius_m / scene.gsd_m)
        if radius_m > 2.0 * scene.gsd_m:
            disc = np.clip((dome - 0.42 + 0.16 * fray) * 4.0, 0.0, 1.0)
        np.maximum(cover, disc, out=cover)
        rise_m = float(growth[group].mean()) * radius_m
        np.maximum(crown_m, rise_m * np.minimum(dome, 1.15) * disc, out=crown_m)
    coverage = np.clip(cover * 255.0, 0.0, 255.0).astype(np.uint8)
    for layer in (overlay.day, overlay.night):
        np.maximum(layer, coverage, out=layer)
    np.maximum(scene.above_m, crown_m, out=scene.above_m)


def _fell(scene: Scene) -> None:
    """Fell up to three stands of trees between the satellite's date and the night."""
    for overlay in scene.overlays:
        if overlay.material is Material.CROWN:
            for _ in range(int(scene.rng.integers(0, 4))):
                centre_px = scene.rng.uniform((0, 0), scene.shape[::-1])
                radius_px = float(scene.rng.uniform(12.0, 45.0)) / scene.gsd_m
                place = (round(centre_px[0]), round(centre_px[1]))
                cv2.circle(overlay.night, place, max(1, round(radius_px)), 0, cv2.FILLED)


def _by_size(radii_m: FloatArray) -> list[NDArray[np.intp]]:
    """Split indices into groups of like radius."""
    if not len(radii_m):
        return []
    groups = np.array_split(np.argsort(radii_m), _RADIUS_CLASSES)
    return [group for group in groups if len(group)]


def _stamped(
    shape: tuple[int, int], points_px: FloatArray, radius_px: float
) -> tuple[ImageArray, ImageArray]:
    """Return coverage and dome height ``(h, w)`` of equal crowns at points inside the image."""
    impulses = np.zeros(shape, dtype=np.float32)
    columns, rows = np.round(points_px).astype(int).T
    impulses[rows, columns] = 1.0
    reach = math.ceil(radius_px + 0.5)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.hypot(x, y)
    disc = np.clip(radius_px + 0.5 - distance, 0.0, 1.0).astype(np.float32)
    disc *= min(1.0, math.pi * radius_px**2 / float(disc.sum()))
    dome = np.sqrt(np.clip(1.0 - (distance / (radius_px + 0.5)) ** 2, 0.0, 1.0)).astype(np.float32)
    domes = cv2.filter2D(impulses, cv2.CV_32F, dome, borderType=cv2.BORDER_CONSTANT)
    if radius_px > 2.0:
        return np.asarray(domes > 0.0, np.float32), np.asarray(domes, np.float32)
    cover = cv2.filter2D(impulses, cv2.CV_32F, disc, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(cover, np.float32), np.asarray(domes, np.float32)


def _jittered_grid(scene: Scene, spacing_m: float) -> FloatArray:
    """Return one random point ``(n, 2)`` in pixels per cell of a grid over the scene."""
    step = max(spacing_m / scene.gsd_m, 1.6)
    height, width = scene.shape
    y, x = np.mgrid[0.0:height:step, 0.0:width:step]
    grid = np.stack([x.ravel(), y.ravel()], axis=1)
    return grid + scene.rng.uniform(0.0, step, grid.shape)


def _values_at(field: ImageArray, points_px: FloatArray) -> FloatArray:
    """Read a field ``(h, w)`` at the nearest pixels to points ``(n, 2)``."""
    limits = np.array(field.shape[::-1]) - 1
    columns, rows = np.clip(np.round(points_px).astype(int), 0, limits).T
    return np.asarray(field[rows, columns], dtype=np.float64)
