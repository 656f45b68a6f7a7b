"""Render sand: dunes, tracks, farm plots and scrub from a height field and a material map.

Over sand and bare soil neither image is a function of the other; both are functions of the ground's
shape. The satellite sees shading under one sun; the thermal camera a random mix of height, shading
under another azimuth, curvature and materials.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.fields import (
    blur,
    directional_derivative,
    fractal_noise,
    standardise,
)
from uasthn_cli.training.pseudo_thermal import thermal_from_colour
from uasthn_cli.types import ImageArray

SAND_PX = 800


@dataclass(frozen=True, slots=True)
class SandScene:
    """Colour ``(n, n, 3)`` in 0..1, height ``(n, n)`` and material temperature ``(n, n)``."""

    rgb: ImageArray
    height: ImageArray
    material: ImageArray


def render_sand(rng: np.random.Generator, size_px: int = SAND_PX) -> SandScene:
    """Return a random stretch of sand of ``size_px`` squared."""
    height = _dunes(rng, size_px)
    shading = standardise(directional_derivative(height, rng.uniform(0, 2 * np.pi)))
    base = np.array([0.80, 0.66, 0.45]) * rng.uniform(0.8, 1.15, 3)
    other = base * rng.uniform(0.75, 1.1, 3)
    mix = 1 / (1 + np.exp(-2 * fractal_noise(rng, size_px, rng.uniform(80, 300), 4)))[..., None]
    rgb = base * (1 - mix) + other * mix + shading[..., None] * rng.uniform(0.01, 0.07)
    rgb = (rgb + 0.01 * fractal_noise(rng, size_px, 6, 2)[..., None]).astype(np.float32)
    material = np.zeros((size_px, size_px), np.float32)
    _add_scrub(rng, rgb, material)
    for _ in range(int(rng.integers(0, 4))):
        _add_track(rng, rgb, material, base)
    for _ in range(int(rng.integers(0, 7))):
        _add_plots(rng, rgb, material)
    return SandScene(np.clip(rgb, 0, 1), standardise(height), material)


def thermal_from_sand(
    rng: np.random.Generator, scene: SandScene, engine: EngineConfig
) -> ImageArray:
    """Return a random pseudo-thermal rendering ``(n, n)`` of a crop of sand."""
    height = blur(scene.height, rng.uniform(0.5, 2.0))
    shading = directional_derivative(height, rng.uniform(0, 2 * np.pi))
    curvature = blur(cv2.Laplacian(height, cv2.CV_32F, ksize=3), 1.0)
    parts = (height, shading, curvature, thermal_from_colour(rng, scene.rgb, engine))
    weights = rng.normal(size=4) * (0.5, 1.0, 0.7, 0.4)
    relief = sum(w * standardise(p) for w, p in zip(weights, parts, strict=True))
    mixed = standardise(np.asarray(relief, np.float32)) * rng.uniform(0.2, 1.0)
    thermal: ImageArray = (mixed + scene.material * rng.uniform(0.5, 2.5)).astype(np.float32)
    return thermal


def _dunes(rng: np.random.Generator, n: int) -> ImageArray:
    """Return the height of one to three wave trains with slip faces, over fractal ground."""
    height = np.zeros((n, n), np.float32)
    rows, columns = np.mgrid[0:n, 0:n].astype(np.float32)
    for _ in range(int(rng.integers(1, 4))):
        direction, wavelength_px = rng.random() * np.pi, rng.uniform(8, 70)
        bend = fractal_noise(rng, n, rng.uniform(50, 250), 4) * rng.uniform(0.4, 4)
        along = columns * np.cos(direction) + rows * np.sin(direction)
        phase = (along / wavelength_px + bend) % 1
        crest = rng.uniform(0.5, 0.9)
        wave = np.where(phase < crest, phase / crest, (1 - phase) / (1 - crest))
        patches = 0.5 + 0.5 * np.tanh(fractal_noise(rng, n, 150, 3))
        height += (rng.uniform(0.3, 1) * wavelength_px / 20 * wave * patches).astype(np.float32)
    return blur(height, rng.uniform(0.7, 2.0)) + 0.15 * fractal_noise(rng, n, 30, 4)


def _add_scrub(rng: np.random.Generator, rgb: ImageArray, material: ImageArray) -> None:
    """Sprinkle bushes, dark by day and of their own temperature at night (in place)."""
    seeds = (rng.random(material.shape) < rng.uniform(0, 0.004)).astype(np.float32)
    bushes = blur(seeds, 0.8)
    rgb -= bushes[..., None] * np.float32(rng.uniform(0.2, 0.6))
    material += bushes * np.float32(rng.normal() * 3)


def _add_track(
    rng: np.random.Generator, rgb: ImageArray, material: ImageArray, base: np.ndarray
) -> None:
    """Draw one winding track (in place)."""
    n = material.shape[0]
    steps = rng.normal(size=(8, 2)) * 40 + rng.normal(size=2) * 90
    points = np.cumsum(np.vstack([rng.uniform(0, n, (1, 2)), steps]), axis=0).astype(np.int32)
    width_px = int(rng.integers(1, 5))
    colour = [float(c) for c in np.clip(base * rng.uniform(0.6, 1.25), 0, 1)]
    cv2.polylines(rgb, [points], False, colour, width_px, cv2.LINE_AA)
    cv2.polylines(material, [points], False, float(rng.normal()), width_px, cv2.LINE_AA)


def _add_plots(rng: np.random.Generator, rgb: ImageArray, material: ImageArray) -> None:
    """Draw one to nine adjoining farm plots with hedges (in place)."""
    n = material.shape[0]
    centre, (width_px, depth_px) = rng.uniform(60, n - 60, 2), rng.uniform(10, 70, 2)
    angle_deg, count = rng.random() * 180, int(rng.integers(1, 4))
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    for i in range(count):
        for j in range(count):
            across = (i - (count - 1) / 2) * width_px * 1.1
            along = (j - (count - 1) / 2) * depth_px * 1.1
            middle = (centre[0] + across * c - along * s, centre[1] + across * s + along * c)
            box = cv2.boxPoints((middle, (width_px, depth_px), angle_deg)).astype(np.int32)
            green = np.array([0.35, 0.42, 0.25]) * rng.uniform(0.6, 1.9, 3)
            cv2.fillPoly(rgb, [box], [float(g) for g in green])
            cv2.fillPoly(material, [box], float(rng.normal() * 1.2))
            if rng.random() < 0.7:
                hedge = [float(h) for h in rng.uniform(0.2, 0.9, 3)]
                cv2.polylines(rgb, [box], True, hedge, 1, cv2.LINE_AA)
                cv2.polylines(material, [box], True, float(rng.normal() * 1.5), 1, cv2.LINE_AA)
