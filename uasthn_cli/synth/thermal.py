"""The place by night in the thermal infrared: apparent temperature of ground and objects.

What the day leaves behind and what the night makes of it, in kelvin: materials by their thermal
inertia and emissivity, slopes that faced the last sun, cold air in hollows, crests that cool to the
open sky, soil moisture (which colours show in part), and slow gradients. The colour image shares
the causes, not the values: no function of a pixel's colour gives its temperature.
"""

import math
from dataclasses import dataclass

import numpy as np

from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.synth.satellite import PLANTS, leaf_texture, row_stripes
from uasthn_cli.synth.scene import Date, Scene
from uasthn_cli.synth.terrain import hollowness, slopes
from uasthn_cli.types import ImageArray


@dataclass(frozen=True, slots=True)
class Night:
    """How strongly each effect shows, in kelvin (per unit of slope, per metre of hollow, ...)."""

    air_k: float
    last_sun_azimuth_rad: float
    last_sun_k: float
    cold_pool_k_per_m: float
    open_sky_k_per_m: float
    steep_k: float
    moisture_k: float
    grain_k: float
    gradient_k: float
    row_k: float


def draw_night_sky(rng: np.random.Generator) -> Night:
    """Draw one night: hour, sky and wind decide which effects are strong."""
    return Night(
        air_k=float(rng.uniform(278.0, 300.0)),
        last_sun_azimuth_rad=math.radians(float(rng.uniform(240.0, 300.0))),
        last_sun_k=float(rng.uniform(1.2, 4.5)),
        cold_pool_k_per_m=float(rng.uniform(0.02, 0.25)),
        open_sky_k_per_m=float(rng.normal(0.0, 0.5)),
        steep_k=float(rng.normal(-0.8, 1.0)),
        moisture_k=float(rng.uniform(0.1, 0.5)),
        grain_k=float(rng.uniform(0.03, 0.12)),
        gradient_k=float(rng.uniform(0.05, 0.4)),
        row_k=float(rng.normal(0.0, 5.0)),
    )


def night_temperature(scene: Scene, night: Night) -> ImageArray:
    """Return the apparent temperature ``(h, w)`` of the scene in kelvin."""
    warmth = np.array([patch.warmth_k for patch in scene.patches], dtype=np.float32)
    rough = np.array([patch.mottle for patch in scene.patches], dtype=np.float32) / 0.06
    temperature: ImageArray = warmth[scene.night]
    texture = rough[scene.night]
    temperature += texture * _grain(scene, night)
    temperature += night.row_k * row_stripes(scene, Date.NIGHT)
    temperature += _relief(scene, night)
    leaves = leaf_texture(scene)
    for overlay in scene.overlays:
        alpha = overlay.night.astype(np.float32) * np.float32(1.0 / 255.0)
        patchy = 0.35 * leaves if overlay.material in PLANTS else np.float32(0.0)
        temperature += alpha * (np.float32(overlay.warmth_k) + patchy - temperature)
    temperature = smooth(temperature, 0.4 / scene.gsd_m)
    slow = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 900.0, finest_m=30.0)
    return temperature + night.gradient_k * slow + np.float32(night.air_k)


def _grain(scene: Scene, night: Night) -> ImageArray:
    """Return moisture and roughness of the ground in kelvin."""
    grain = fractal_noise(scene.rng, scene.shape, scene.gsd_m, 5.0, roughness=0.8)
    return night.moisture_k * scene.moisture + night.grain_k * grain


def _relief(scene: Scene, night: Night) -> ImageArray:
    """Return what the shape of the ground adds in kelvin."""
    ground = smooth(scene.ground_m, 0.6)
    east, north = slopes(ground, scene.gsd_m)
    toward_e, toward_n = math.sin(night.last_sun_azimuth_rad), math.cos(night.last_sun_azimuth_rad)
    steepness = np.hypot(east, north)
    hollow = np.clip(hollowness(ground, scene.gsd_m, 50.0), -6.0, 6.0)
    bend = np.clip(hollowness(ground, scene.gsd_m, max(4.0, 2.0 * scene.gsd_m)), -1.0, 1.0)
    total = -night.last_sun_k * (east * toward_e + north * toward_n)
    total += night.steep_k * steepness
    total -= night.cold_pool_k_per_m * hollow
    total += night.open_sky_k_per_m * bend
    return np.asarray(np.clip(total, -4.0, 4.0), dtype=np.float32)
