"""Plants that stand alone: forest crowns, orchards, hedges and scrub dots."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.synth.layout import Axes, Plot
from uasthn_cli.synth.materials import Material
from uasthn_cli.synth.noise import fractal_noise
from uasthn_cli.synth.scene import Overlay, Scene
from uasthn_cli.types import BoolArray, FloatArray, ImageArray

_RADIUS_CLASSES = 4


def forest(scene: Scene, mask: BoolArray, spacing_m: float) -> None:
    """Fill a mask with crowns about ``spacing_m`` apart, with glades and edges left open."""
    density = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 90.0, finest_m=6.0)
    points = _jittered_grid(scene, spacing_m)
    keep = _values_at(density, points) > scene.rng.normal(-1.5, 0.5, len(points))
    points = points[keep & (_values_at(mask.astype(np.float32), points) > 0.5)]
    radii_m = 0.62 * spacing_m * scene.rng.lognormal(0.0, 0.22, len(points))
    plant(scene, crown_overlay(scene, Material.CROWN), points, radii_m, height_per_radius=3.2)


def scrub(scene: Scene, mask: BoolArray, per_hectare: float) -> None:
    """Scatter shrubs over a mask in loose groups."""
    groups = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 120.0, roughness=0.65)
    width_m, height_m = scene.extent_m
    count = int(min(per_hectare * width_m * height_m / 1e4, 60_000))
    points = scene.rng.uniform((0, 0), scene.shape[::-1], (3 * count, 2))
    liking = np.exp(1.3 * _values_at(groups, points)) * _values_at(mask.astype(np.float32), points)
    points = points[scene.rng.uniform(0.0, 6.0, len(points)) < liking]
    radii_m = np.clip(scene.rng.lognormal(math.log(1.1), 0.45, len(points)), 0.5, 4.0)
    plant(scene, crown_overlay(scene, Material.SCRUB), points, radii_m, height_per_radius=1.2)


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


def crown_overlay(scene: Scene, material: Material) -> Overlay:
    """Return the scene's overlay of a kind of plant, made on first use."""
    for overlay in scene.overlays:
        if overlay.material is material:
            return overlay
    return scene.new_overlay(material)


def plant(
    scene: Scene,
    overlay: Overlay,
    points_px: FloatArray,
    radii_m: FloatArray,
    *,
    height_per_radius: float,
) -> None:
    """Set plants with crowns of the radii given: coverage on both dates, height by day."""
    radii_px = radii_m / scene.gsd_m
    for group in _by_size(radii_px):
        radius_px = float(radii_px[group].mean())
        cover, dome = _stamped(scene.shape, points_px[group], radius_px)
        coverage = np.clip(cover * 255.0, 0.0, 255.0).astype(np.uint8)
        np.maximum(overlay.day, coverage, out=overlay.day)
        np.maximum(overlay.night, coverage, out=overlay.night)
        height_m = (height_per_radius * radius_px * scene.gsd_m) * np.minimum(dome, 1.2)
        np.maximum(scene.above_m, height_m, out=scene.above_m)


def _by_size(radii_px: FloatArray) -> list[NDArray[np.intp]]:
    """Split indices into groups of like radius."""
    if not len(radii_px):
        return []
    return [group for group in np.array_split(np.argsort(radii_px), _RADIUS_CLASSES) if len(group)]


def _stamped(
    shape: tuple[int, int], points_px: FloatArray, radius_px: float
) -> tuple[ImageArray, ImageArray]:
    """Return coverage and dome height ``(h, w)`` of equal crowns at the points."""
    impulses = np.zeros(shape, dtype=np.float32)
    columns, rows = np.round(points_px).astype(int).T
    inside = (columns >= 0) & (rows >= 0) & (columns < shape[1]) & (rows < shape[0])
    impulses[rows[inside], columns[inside]] = 1.0
    reach = math.ceil(radius_px + 0.5)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.hypot(x, y)
    disc = np.clip(radius_px + 0.5 - distance, 0.0, 1.0).astype(np.float32)
    disc *= min(1.0, math.pi * radius_px**2 / float(disc.sum()))
    dome = np.sqrt(np.clip(1.0 - (distance / (radius_px + 0.5)) ** 2, 0.0, 1.0)).astype(np.float32)
    cover = cv2.filter2D(impulses, cv2.CV_32F, disc, borderType=cv2.BORDER_CONSTANT)
    domes = cv2.filter2D(impulses, cv2.CV_32F, dome, borderType=cv2.BORDER_CONSTANT)
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
