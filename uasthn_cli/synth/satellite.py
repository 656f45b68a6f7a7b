"""The place by day from space: colours, texture, sunlight, shadows, haze, a blurred sensor."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.synth.materials import Climate, Material
from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.synth.scene import Date, Scene
from uasthn_cli.synth.terrain import cast_shadow, hollowness, slopes, sunlight
from uasthn_cli.types import ImageArray

PLANTS = (Material.CROWN, Material.SCRUB)


@dataclass(frozen=True, slots=True)
class Daylight:
    """Sun and picture processing of one satellite image.

    ``moisture_seen`` is how much of the ground's blotches is the soil's moisture, darkening it
    where negative: the rest is there by day only.
    """

    azimuth_rad: float
    elevation_rad: float
    relief_contrast: float
    haze: float
    moisture_seen: float
    contrast: float
    tint: tuple[float, float, float]
    blur_px: float


def draw_daylight(rng: np.random.Generator) -> Daylight:
    """Draw a sun between morning and afternoon (one in five south of the equator) and a look."""
    azimuth = rng.uniform(100.0, 230.0) - (180.0 if rng.random() < 0.2 else 0.0)
    tint = rng.normal(1.0, 0.02, 3)
    return Daylight(
        azimuth_rad=math.radians(azimuth),
        elevation_rad=math.radians(rng.uniform(38.0, 65.0)),
        relief_contrast=float(rng.uniform(0.5, 1.0)),
        haze=float(rng.uniform(0.0, 0.10)),
        moisture_seen=float(rng.uniform(-0.9, 0.3)),
        contrast=float(rng.uniform(0.85, 1.15)),
        tint=(float(tint[0]), float(tint[1]), float(tint[2])),
        blur_px=float(rng.uniform(0.45, 0.8)),
    )


def satellite_image(scene: Scene, daylight: Daylight) -> NDArray[np.uint8]:
    """Return the scene's satellite image ``(h, w, 3)`` RGB."""
    image = _patch_colours(scene)
    image *= np.float32(1.0) + _texture(scene, daylight)
    _tint_ground(scene, image)
    leaves = leaf_texture(scene)
    for overlay in scene.overlays:
        alpha = overlay.day.astype(np.float32) * np.float32(1.0 / 255.0)
        patchiness = np.float32(0.16 if overlay.material in PLANTS else 0.0)
        tone = np.float32(1.0) + patchiness * leaves
        for channel, value in enumerate(overlay.colour):
            image[channel] += alpha * (np.float32(value) * tone - image[channel])
    _light(scene, image, daylight)
    return _developed(scene, image, daylight)


def row_stripes(scene: Scene, date: Date) -> ImageArray:
    """Return the row pattern ``(h, w)``: each patch's stripes times its row contrast.

    Narrow tram lines at the row spacing, and swaths some three rows wide (a seeder, a mower).
    Rows closer than two pixels fade out instead of aliasing.
    """
    patches = scene.patches
    spacing_px = np.array([patch.row_spacing_m for patch in patches]) / scene.gsd_m
    angles = np.array([patch.row_angle_rad for patch in patches])
    visible = np.clip((spacing_px - 2.0) / 2.0, 0.0, 1.0)
    contrast = (np.array([p.row_contrast for p in patches]) * visible).astype(np.float32)
    index = scene.rasters(date)[0]
    if not contrast[np.bincount(index.ravel(), minlength=len(patches)) > 0].any():
        return np.zeros(scene.shape, dtype=np.float32)
    wave_x = (2.0 * math.pi * np.cos(angles) / spacing_px).astype(np.float32)
    wave_y = (2.0 * math.pi * np.sin(angles) / spacing_px).astype(np.float32)
    y, x = np.indices(scene.shape, dtype=np.float32)
    phase = wave_x[index] * x + wave_y[index] * y
    phase += 0.5 * fractal_noise(scene.rng, scene.shape, scene.gsd_m, 80.0, finest_m=10.0)
    swath = np.float32(0.5) + np.float32(0.5) * np.cos(phase)
    lines = swath * swath
    lines *= lines
    waves = np.float32(0.6) * np.sin(np.float32(0.31) * phase) - np.float32(1.8) * lines
    return np.asarray(contrast[index] * (waves + np.float32(0.5)), dtype=np.float32)


def leaf_texture(scene: Scene) -> ImageArray:
    """Return how crowns differ from one another and leaf by leaf ``(h, w)``, unit deviation."""
    return fractal_noise(scene.rng, scene.shape, scene.gsd_m, 14.0, roughness=0.75, finest_m=1.0)


def _patch_colours(scene: Scene) -> ImageArray:
    """Return the bare colour ``(3, h, w)`` of every pixel's patch (planes: quicker to work on)."""
    table = np.array([patch.colour for patch in scene.patches], dtype=np.float32)
    return np.stack([values[scene.day] for values in table.T])


def _texture(scene: Scene, daylight: Daylight) -> ImageArray:
    """Return relative brightness changes: grain and blotches by patch, rows."""
    mottle = np.array([patch.mottle for patch in scene.patches], dtype=np.float32)
    grain = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 6.0, roughness=0.8)
    blotches = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 110.0, roughness=0.6)
    blotches *= np.float32(math.sqrt(1.0 - daylight.moisture_seen**2))
    blotches += np.float32(daylight.moisture_seen) * scene.moisture
    texture: ImageArray = mottle[scene.day] * (0.5 * grain + blotches)
    return texture + row_stripes(scene, Date.DAY)


def _tint_ground(scene: Scene, image: ImageArray) -> None:
    """Vary the hue slowly; darken damp hollows; redden steep sand, grey the sand of hollows."""
    drift = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 700.0, finest_m=15.0)
    axis = (scene.rng.normal(0.0, 0.012) + scene.rng.normal(0.0, 0.004, 3)).astype(np.float32)
    for channel, share in enumerate(axis):
        image[channel] += share * drift
    materials = np.array([patch.material for patch in scene.patches])
    sandy = np.isin(materials, (Material.SAND,)).astype(np.float32)[scene.day]
    hollow = np.clip(hollowness(scene.ground_m, scene.gsd_m, 40.0) / 2.0, -1.0, 1.0)
    if scene.climate is Climate.TEMPERATE:
        image *= np.float32(1.0) - np.float32(0.07) * hollow
    elif sandy.any():
        east, north = slopes(scene.ground_m, scene.gsd_m)
        steep = sandy * np.minimum(2.0 * np.hypot(east, north), np.float32(1.0))
        hollow = sandy * hollow
        for channel, (red, grey) in enumerate(((0.05, -0.03), (0.005, -0.012), (-0.03, 0.0))):
            image[channel] += np.float32(red) * steep + np.float32(grey) * hollow


def _light(scene: Scene, image: ImageArray, daylight: Daylight) -> None:
    """Shade relief and crowns, and darken what lies in shadow (skylight stays, a little blue)."""
    surface = scene.ground_m + scene.above_m * _crown_share(scene)
    light = sunlight(surface, scene.gsd_m, daylight.azimuth_rad, daylight.elevation_rad)
    contrast = np.float32(0.75 * daylight.relief_contrast)
    gain = np.float32(1.0) + contrast * (light - np.float32(1.0))
    shadow = cast_shadow(scene.above_m, scene.gsd_m, daylight.azimuth_rad, daylight.elevation_rad)
    shadow = smooth(shadow, 0.5)
    for channel, kept in enumerate((0.36, 0.40, 0.47)):
        image[channel] *= gain * (np.float32(1.0) - np.float32(1.0 - kept) * shadow)


def _crown_share(scene: Scene) -> ImageArray:
    """Return where heights above ground are crowns (rounded) rather than roofs (flat)."""
    share = np.zeros(scene.shape, dtype=np.float32)
    for overlay in scene.overlays:
        if overlay.material in PLANTS:
            share = np.maximum(share, overlay.day * np.float32(0.35 / 255.0))
    return share


def _developed(scene: Scene, image: ImageArray, daylight: Daylight) -> NDArray[np.uint8]:
    """Blur by the satellite's optics, add haze and grain, stretch, quantise: ``(h, w, 3)``."""
    grain = scene.rng.standard_normal(scene.shape, dtype=np.float32)
    grain = smooth(grain, 0.6) * np.float32(0.006)
    mean = float(image.mean())
    developed = np.empty((*scene.shape, 3), dtype=np.uint8)
    for channel, air in enumerate((0.62, 0.68, 0.74)):
        kept = daylight.tint[channel] * (1.0 - daylight.haze)
        gain = kept * daylight.contrast
        offset = kept * mean * (1.0 - daylight.contrast) + daylight.haze * air
        plane = smooth(image[channel], daylight.blur_px)
        plane = plane * np.float32(gain) + (grain + np.float32(offset))
        # convertScaleAbs rounds and saturates in one pass; negatives must not fold back.
        developed[..., channel] = cv2.convertScaleAbs(np.maximum(plane, 0.0), alpha=255.0)
    return developed
