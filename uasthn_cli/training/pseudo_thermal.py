"""Render a night-thermal look from a daylight colour image.

What is warm at night is not a function of colour, so every sample draws another one: random tone
curves of random colour projections, random temperatures of colour clusters (vegetation, roads and
roofs against soil: the sign is free), random texture terms, and Riesz transforms for relief.
"""

import cv2
import numpy as np

from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.fields import blur, riesz_transform, standardise
from uasthn_cli.types import ImageArray

RIESZ_SHARE = 0.4
TEXTURE_SHARE = 0.6


def thermal_from_colour(
    rng: np.random.Generator, rgb: ImageArray, engine: EngineConfig
) -> ImageArray:
    """Return a random pseudo-thermal rendering ``(h, w)``, unit deviation, of ``rgb`` in 0..1."""
    mean, deviation = cv2.meanStdDev(rgb)
    colour = ((rgb - mean[:, 0]) / (deviation.mean() + 1e-3)).astype(np.float32)
    share, projection = rng.random(), colour @ rng.normal(size=3).astype(np.float32)
    thermal = share * _tone_curve(rng, projection, bent=engine.tone_curves)
    if engine.cluster_temperatures:
        thermal = thermal + 1.5 * rng.random() * _cluster_temperatures(rng, colour)
    grey = colour @ np.full(3, 1 / 3, np.float32)
    if engine.texture:
        thermal = thermal + _texture(rng, grey)
    thermal = standardise(thermal)
    if engine.relief and rng.random() < RIESZ_SHARE:
        relief = standardise(riesz_transform(grey, rng.uniform(0.0, 2.0 * np.pi)))
        thermal = standardise(thermal + rng.uniform(0.3, 1.5) * relief)
    return thermal


def _texture(rng: np.random.Generator, grey: ImageArray) -> ImageArray:
    """Return fine structure of either sign, rectified, as it is, both or none."""
    detail = grey - blur(grey, rng.uniform(1.0, 6.0))
    texture = np.zeros_like(grey)
    if rng.random() < TEXTURE_SHARE:
        texture += np.float32(0.3 * rng.normal()) * blur(np.abs(detail), rng.uniform(0.7, 3.0))
    if rng.random() < TEXTURE_SHARE:
        texture += np.float32(0.2 * rng.normal()) * detail
    return texture


def _tone_curve(rng: np.random.Generator, values: ImageArray, *, bent: bool) -> ImageArray:
    """Return a random piecewise linear function of ``values``, or just ``values``, in 0..1."""
    low, high = float(values.min()), float(values.max())
    curve = np.linspace(0, 1, 256)
    if bent:
        knots = int(rng.integers(3, 8))
        curve = np.interp(curve, np.linspace(0, 1, knots), rng.random(knots))
    index = ((values - low) * (255.0 / (high - low + 1e-6))).astype(np.uint8)
    return curve.astype(np.float32)[index]


def _cluster_temperatures(rng: np.random.Generator, colour: ImageArray) -> ImageArray:
    """Return soft colour clusters, each with a random temperature in 0..1."""
    smooth = cv2.GaussianBlur(colour, (0, 0), rng.uniform(0.5, 2.0)).reshape(-1, 3).T
    clusters = int(rng.integers(3, 12))
    centres = smooth[:, rng.integers(0, smooth.shape[1], clusters)].T
    squared = (smooth**2).sum(axis=0) + (centres**2).sum(axis=1)[:, None]
    distance = squared - 2 * centres @ smooth
    weights = np.exp(np.float32(rng.uniform(1.0, 6.0)) * (distance.min(axis=0) - distance))
    temperatures = rng.random(clusters).astype(np.float32)
    mixed = temperatures @ weights / weights.sum(axis=0)
    rendered: ImageArray = mixed.reshape(colour.shape[:2]).astype(np.float32)
    return rendered
