"""What the ground is made of: colours by day, warmth by night, and how both vary.

Colours are display values (sRGB, 0..1) read off Bing and NAIP imagery of desert and prairie.
Warmth is the apparent temperature in kelvin against dry bare ground some hours after sunset: water
and pavement have stored the day's heat, crowns stay near air temperature, irrigated or grassed
ground cools by evaporation, bare metal roofs reflect the cold sky.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np


class Material(IntEnum):
    """Kinds of ground cover; the values of ``Landscape.material``."""

    SAND = 0
    SOIL = 1
    GRASS = 2
    CROP = 3
    STUBBLE = 4
    WATER = 5
    PAVED = 6
    TRACK = 7
    ROOF = 8
    CONCRETE = 9
    CROWN = 10
    SCRUB = 11
    VEHICLE = 12
    MARSH = 13


class Climate(StrEnum):
    """Decides colours and what grows."""

    ARID = "arid"
    TEMPERATE = "temperate"


@dataclass(frozen=True, slots=True)
class Warmth:
    """Night warmth: mean, deviation from one landscape to the next, and from patch to patch."""

    mean_k: float
    between_nights_k: float
    between_patches_k: float


WARMTH: dict[Material, Warmth] = {
    Material.SAND: Warmth(0.0, 0.3, 0.2),
    Material.SOIL: Warmth(0.3, 0.5, 0.5),
    Material.GRASS: Warmth(-0.7, 0.7, 0.4),
    Material.CROP: Warmth(-0.6, 1.0, 0.8),
    Material.STUBBLE: Warmth(0.1, 0.6, 0.5),
    Material.WATER: Warmth(4.0, 2.5, 0.4),
    Material.PAVED: Warmth(3.0, 0.9, 0.4),
    Material.TRACK: Warmth(1.5, 0.6, 0.3),
    Material.ROOF: Warmth(-2.0, 1.2, 2.2),
    Material.CONCRETE: Warmth(2.0, 0.8, 0.8),
    Material.CROWN: Warmth(1.8, 0.8, 0.4),
    Material.SCRUB: Warmth(1.4, 0.6, 0.3),
    Material.VEHICLE: Warmth(0.0, 1.0, 3.0),
    Material.MARSH: Warmth(1.0, 1.0, 0.4),
}

Colour = tuple[float, float, float]

_ARID: dict[Material, list[Colour]] = {
    Material.SAND: [(0.77, 0.66, 0.48), (0.80, 0.68, 0.50), (0.74, 0.62, 0.47)],
    Material.SOIL: [(0.66, 0.56, 0.43), (0.71, 0.61, 0.47), (0.58, 0.49, 0.38)],
    Material.GRASS: [(0.53, 0.51, 0.37), (0.47, 0.47, 0.33)],
    Material.CROP: [(0.36, 0.41, 0.27), (0.42, 0.45, 0.31), (0.30, 0.37, 0.23)],
    Material.STUBBLE: [(0.68, 0.60, 0.43), (0.62, 0.56, 0.41)],
    Material.WATER: [(0.22, 0.34, 0.33), (0.30, 0.40, 0.36)],
    Material.PAVED: [(0.45, 0.43, 0.41), (0.53, 0.50, 0.46)],
    Material.TRACK: [(0.84, 0.75, 0.60), (0.79, 0.70, 0.55), (0.80, 0.75, 0.65)],
    Material.ROOF: [
        (0.86, 0.84, 0.79),
        (0.60, 0.56, 0.51),
        (0.72, 0.66, 0.57),
        (0.45, 0.43, 0.42),
        (0.52, 0.59, 0.66),
        (0.93, 0.92, 0.90),
    ],
    Material.CONCRETE: [(0.72, 0.69, 0.63), (0.64, 0.61, 0.56)],
    Material.CROWN: [(0.27, 0.30, 0.20), (0.32, 0.34, 0.23)],
    Material.SCRUB: [(0.45, 0.42, 0.31), (0.38, 0.38, 0.28)],
    Material.VEHICLE: [(0.92, 0.92, 0.92), (0.25, 0.25, 0.27), (0.60, 0.61, 0.63)],
    Material.MARSH: [(0.40, 0.39, 0.28), (0.34, 0.36, 0.25)],
}

_TEMPERATE: dict[Material, list[Colour]] = {
    Material.SAND: [(0.74, 0.69, 0.57), (0.69, 0.64, 0.53)],
    Material.SOIL: [(0.47, 0.39, 0.30), (0.57, 0.50, 0.40), (0.38, 0.31, 0.25), (0.64, 0.59, 0.50)],
    Material.GRASS: [(0.33, 0.40, 0.28), (0.42, 0.47, 0.33), (0.50, 0.51, 0.38)],
    Material.CROP: [
        (0.22, 0.34, 0.23),
        (0.29, 0.40, 0.27),
        (0.18, 0.29, 0.20),
        (0.37, 0.46, 0.31),
        (0.49, 0.52, 0.34),
    ],
    Material.STUBBLE: [(0.66, 0.61, 0.45), (0.57, 0.55, 0.40), (0.71, 0.65, 0.49)],
    Material.WATER: [
        (0.16, 0.21, 0.22),
        (0.24, 0.34, 0.27),
        (0.12, 0.15, 0.17),
        (0.32, 0.36, 0.28),
    ],
    Material.PAVED: [(0.42, 0.42, 0.42), (0.55, 0.54, 0.52), (0.34, 0.34, 0.35)],
    Material.TRACK: [(0.66, 0.60, 0.50), (0.72, 0.68, 0.60), (0.56, 0.50, 0.41)],
    Material.ROOF: [
        (0.52, 0.31, 0.25),
        (0.38, 0.37, 0.37),
        (0.60, 0.58, 0.55),
        (0.85, 0.85, 0.84),
        (0.47, 0.38, 0.33),
        (0.29, 0.29, 0.31),
    ],
    Material.CONCRETE: [(0.66, 0.65, 0.62), (0.58, 0.57, 0.55)],
    Material.CROWN: [(0.19, 0.27, 0.16), (0.24, 0.32, 0.18), (0.29, 0.34, 0.19)],
    Material.SCRUB: [(0.31, 0.35, 0.22), (0.38, 0.40, 0.27)],
    Material.VEHICLE: [
        (0.93, 0.93, 0.93),
        (0.15, 0.15, 0.17),
        (0.55, 0.56, 0.58),
        (0.55, 0.15, 0.13),
    ],
    Material.MARSH: [(0.31, 0.36, 0.21), (0.42, 0.44, 0.27)],
}

_NEUTRAL = {Material.PAVED, Material.CONCRETE, Material.SAND, Material.VEHICLE, Material.WATER}

_PALETTES = {Climate.ARID: _ARID, Climate.TEMPERATE: _TEMPERATE}


def draw_colour(rng: np.random.Generator, climate: Climate, material: Material) -> Colour:
    """Draw the colour of one patch: a palette entry, its brightness and hue slightly varied."""
    palette = _PALETTES[climate][material]
    base = np.asarray(palette[int(rng.integers(len(palette)))])
    hue = 0.008 if material in _NEUTRAL else 0.012
    varied = np.clip(base * rng.normal(1.0, 0.06) * rng.normal(1.0, hue, 3), 0.03, 0.97)
    return float(varied[0]), float(varied[1]), float(varied[2])


def draw_night(rng: np.random.Generator) -> dict[Material, float]:
    """Draw how warm each material is on one night, in kelvin against dry bare ground."""
    return {
        material: float(rng.normal(warmth.mean_k, warmth.between_nights_k))
        for material, warmth in WARMTH.items()
    }
