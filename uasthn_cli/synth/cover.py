"""What covers open ground: soils and grass in ragged patches, sand, lakes with their shores."""

import cv2
import numpy as np

from uasthn_cli.synth.materials import Climate, Material
from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.synth.scene import Patch, Scene, fill_ring
from uasthn_cli.types import BoolArray, FloatArray


def open_ground(scene: Scene) -> None:
    """Lay the first patches: sand and gravel where it is arid, else grass and soil in pieces."""
    arid = scene.climate is Climate.ARID
    first = Material.SAND if arid else Material.GRASS
    scene.fill(_outline(scene), scene.new_patch(first, mottle=0.02 if arid else 0.07))
    if arid:
        for _ in range(int(scene.rng.integers(0, 3))):
            _gravel_flat(scene, scene.patches[0])
        return
    for _ in range(3):
        share, scale_m = scene.rng.uniform(0.1, 0.4), scene.rng.uniform(150.0, 500.0)
        mask = ragged_mask(scene, float(share), float(scale_m), roughness=0.68)
        material = Material.SOIL if scene.rng.random() < 0.35 else Material.GRASS
        scene.paint(mask, thin_patch(scene, material, float(scene.rng.uniform(0.2, 0.7))))


def thin_patch(scene: Scene, material: Material, cover: float) -> int:
    """Add a patch of a material that covers only a part of the scene's first ground."""
    under = scene.patches[0]
    index = scene.new_patch(material, mottle=float(scene.rng.uniform(0.05, 0.1)))
    over = scene.patches[index]
    r, g, b = (
        cover * a + (1.0 - cover) * c for a, c in zip(over.colour, under.colour, strict=True)
    )
    warmth_k = cover * over.warmth_k + (1.0 - cover) * under.warmth_k
    scene.patches[index] = Patch(material, (r, g, b), warmth_k, over.mottle)
    return index


def _gravel_flat(scene: Scene, sand: Patch) -> None:
    """Bare the ground between dunes: a little darker and greyer than the sand beside it."""
    bluer = abs(scene.rng.normal(0.0, 0.03))
    shade = scene.rng.normal(0.95, 0.025) * np.array([1.0, 1.0, 1.0 + bluer])
    r, g, b = (float(channel) for channel in np.asarray(sand.colour) * shade)
    warmth_k = sand.warmth_k + float(scene.rng.normal(0.0, 0.25))
    flat = scene.add_patch(Patch(Material.SAND, (r, g, b), warmth_k, 0.03))
    ragged = fractal_noise(
        scene.rng, scene.shape, scene.gsd_m, 120.0, roughness=0.65, finest_m=2.0 * scene.gsd_m
    )
    low = scene.ground_m + np.float32(0.5) * ragged
    level = np.quantile(cv2.resize(low, (64, 64)), scene.rng.uniform(0.08, 0.35))
    scene.paint(np.asarray(low < level), flat)


def ragged_mask(
    scene: Scene, share: float, wavelength_m: float, roughness: float = 0.55
) -> BoolArray:
    """Return a ragged mask ``(h, w)`` that covers about ``share`` of the scene."""
    field = fractal_noise(
        scene.rng,
        scene.shape,
        scene.gsd_m,
        wavelength_m,
        roughness=roughness,
        finest_m=2.0 * scene.gsd_m,
    )
    sample = cv2.resize(field, (64, 64), interpolation=cv2.INTER_AREA)
    return np.asarray(field > np.quantile(sample, 1.0 - share))


def level_ground(scene: Scene, mask: BoolArray) -> None:
    """Level dunes and bumps where people farm or build: only the ground's wide shape stays."""
    share = smooth(mask.astype(np.float32), 5.0 / scene.gsd_m)
    scene.ground_m += share * (smooth(scene.ground_m, 60.0 / scene.gsd_m) - scene.ground_m)


def lakes(scene: Scene, share: float) -> BoolArray:
    """Flood the lowest ``share`` of the ground; reeds and bare shores around. Return the water."""
    ground = smooth(scene.ground_m, 3.0 / scene.gsd_m)
    levels = np.quantile(cv2.resize(ground, (96, 96)), (share, min(0.98, 1.35 * share + 0.01)))
    shore = scene.new_patch(Material.MARSH, mottle=0.10)
    beach = scene.new_patch(Material.SOIL, mottle=0.05)
    water = scene.new_patch(Material.WATER, mottle=0.015)
    wet = ground < levels[0]
    wobble = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 60.0)
    rise = levels[1] - levels[0]
    scene.paint(ground < levels[0] + rise * np.clip(0.6 + 0.5 * wobble, 0.0, 2.0), shore)
    scene.paint(ground < levels[0] + 0.12 * rise * np.clip(0.5 + wobble, 0.0, 2.0), beach)
    scene.paint(wet, water)
    np.maximum(scene.ground_m, np.float32(levels[0]), out=scene.ground_m)
    return np.asarray(wet)


def ragged_fill(scene: Scene, ring_px: FloatArray, patch: int, fray_m: float) -> None:
    """Fill polygon ``(n, 2)`` with a patch, its edge frayed by about ``fray_m``."""
    limits = np.array(scene.shape[::-1])
    margin_px = 2.0 * fray_m / scene.gsd_m
    low = np.clip(np.floor(ring_px.min(axis=0) - margin_px), 0, limits).astype(int)
    high = np.clip(np.ceil(ring_px.max(axis=0) + margin_px), 0, limits).astype(int)
    if (high - low).min() < 2:
        return
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    inside = np.zeros(high[::-1] - low[::-1], dtype=np.float32)
    fill_ring(inside, ring_px - low, 1.0)
    inside = smooth(inside, fray_m / scene.gsd_m)
    size = (inside.shape[0], inside.shape[1])
    inside += 0.2 * fractal_noise(scene.rng, size, scene.gsd_m, 4.0 * fray_m, roughness=0.7)
    for raster in (scene.day, scene.night):
        raster[window][inside > 0.5] = patch


def _outline(scene: Scene) -> FloatArray:
    """Return a ring around the whole scene in pixels."""
    height, width = scene.shape
    return np.array([[-2.0, -2.0], [width + 2, -2], [width + 2, height + 2], [-2, height + 2]])
