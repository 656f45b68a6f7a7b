"""What covers open ground: soils and grass in ragged patches, sand, lakes with their shores."""

import cv2
import numpy as np

from uasthn_cli.synth.materials import Climate, Material
from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.synth.scene import Scene
from uasthn_cli.types import BoolArray, FloatArray


def open_ground(scene: Scene) -> None:
    """Lay the first patches: soil and grass (sand and soil where it is arid) in ragged pieces."""
    arid = scene.climate is Climate.ARID
    first = Material.SAND if arid else Material.GRASS
    scene.fill(_outline(scene), scene.new_patch(first, mottle=0.035 if arid else 0.07))
    for _ in range(3):
        share = float(scene.rng.uniform(0.1, 0.4))
        scale_m = float(scene.rng.uniform(150.0, 500.0))
        others = (Material.SAND, Material.SOIL) if arid else (Material.GRASS, Material.SOIL)
        material = others[int(scene.rng.random() < 0.35)]
        patch = scene.new_patch(material, mottle=float(scene.rng.uniform(0.03, 0.09)))
        scene.paint(ragged_mask(scene, share, scale_m), patch)


def ragged_mask(scene: Scene, share: float, wavelength_m: float) -> BoolArray:
    """Return a ragged mask ``(h, w)`` that covers about ``share`` of the scene."""
    field = fractal_noise(scene.rng, scene.shape, scene.gsd_m, wavelength_m, roughness=0.55)
    sample = cv2.resize(field, (64, 64), interpolation=cv2.INTER_AREA)
    return np.asarray(field > np.quantile(sample, 1.0 - share))


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


def _outline(scene: Scene) -> FloatArray:
    """Return a ring around the whole scene in pixels."""
    height, width = scene.shape
    return np.array([[-2.0, -2.0], [width + 2, -2], [width + 2, height + 2], [-2, height + 2]])
