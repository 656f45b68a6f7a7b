"""The place while it is being drawn: patches of ground on two dates, lines and dots over them."""

from dataclasses import dataclass, field
from enum import Flag, auto
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.synth.materials import WARMTH, Climate, Colour, Material, draw_colour, draw_night
from uasthn_cli.synth.noise import fractal_noise
from uasthn_cli.types import BoolArray, FloatArray, ImageArray

_SUBPIXEL_BITS = 4


class Date(Flag):
    """When a thing is there: the day of the satellite image, the night of the flight, or both."""

    DAY = auto()
    NIGHT = auto()
    BOTH = DAY | NIGHT


@dataclass(frozen=True, slots=True)
class Patch:
    """The look of one piece of ground.

    ``row_contrast`` and ``mottle`` are relative changes of brightness by rows (crop rows, tram
    lines, mowing stripes) and by texture.
    """

    material: Material
    colour: Colour
    warmth_k: float
    mottle: float = 0.05
    row_angle_rad: float = 0.0
    row_spacing_m: float = 10.0
    row_contrast: float = 0.0


@dataclass(frozen=True, slots=True)
class Overlay:
    """Lines or dots over the ground: coverage ``(h, w)`` uint8 (255 = opaque) on either date."""

    material: Material
    colour: Colour
    warmth_k: float
    day: NDArray[np.uint8]
    night: NDArray[np.uint8]

    def layers(self, date: Date) -> list[NDArray[np.uint8]]:
        """Return the coverage of the dates asked for."""
        return [self.day] * bool(date & Date.DAY) + [self.night] * bool(date & Date.NIGHT)


@dataclass(frozen=True, slots=True)
class Planting:
    """Plants still to be drawn: places ``(n, 2)`` in pixels, crown radii ``(n,)`` in metres."""

    material: Material
    points_px: FloatArray
    radii_m: FloatArray
    height_per_radius: float


@dataclass(slots=True)
class Scene:
    """Rasters ``(h, w)`` being filled in; ``day`` and ``night`` hold indices into ``patches``.

    ``ground_m`` is the bare ground, ``above_m`` the height of roofs and crowns over it on the
    satellite's date, ``moisture`` what the soil holds, of unit deviation.
    """

    gsd_m: float
    rng: np.random.Generator
    climate: Climate
    ground_m: ImageArray
    above_m: ImageArray
    moisture: ImageArray
    day: NDArray[np.uint16]
    night: NDArray[np.uint16]
    night_warmth_k: dict[Material, float]
    patches: list[Patch] = field(default_factory=list)
    overlays: list[Overlay] = field(default_factory=list)
    plantings: list[Planting] = field(default_factory=list)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        height, width = self.ground_m.shape
        return height, width

    @property
    def extent_m(self) -> tuple[float, float]:
        """Width and height in metres."""
        height, width = self.shape
        return width * self.gsd_m, height * self.gsd_m

    def warmth_k(self, material: Material) -> float:
        """Draw the warmth of one more patch of a material on this scene's night."""
        spread = WARMTH[material].between_patches_k
        return self.night_warmth_k[material] + float(self.rng.normal(0.0, spread))

    def new_patch(
        self,
        material: Material,
        *,
        mottle: float = 0.05,
        row_angle_rad: float = 0.0,
        row_spacing_m: float = 10.0,
        row_contrast: float = 0.0,
    ) -> int:
        """Add a patch of a material with a drawn colour and warmth; return its index."""
        colour = draw_colour(self.rng, self.climate, material)
        warmth_k = self.warmth_k(material)
        return self.add_patch(
            Patch(material, colour, warmth_k, mottle, row_angle_rad, row_spacing_m, row_contrast)
        )

    def add_patch(self, patch: Patch) -> int:
        """Add a patch; return its index."""
        self.patches.append(patch)
        return len(self.patches) - 1

    def new_overlay(self, material: Material) -> Overlay:
        """Add an empty overlay of a material on top of those that are there."""
        blank = np.zeros((2, *self.shape), dtype=np.uint8)
        colour = draw_colour(self.rng, self.climate, material)
        if material is Material.TRACK and self.climate is Climate.ARID:
            colour = self._worn(self.patches[0].colour)
        overlay = Overlay(material, colour, self.warmth_k(material), blank[0], blank[1])
        self.overlays.append(overlay)
        return overlay

    def _worn(self, ground: Colour) -> Colour:
        """Return the colour of driven-on ground: paler, sometimes darker, less coloured."""
        grey = sum(ground) / 3.0
        gain = float(self.rng.choice([1.0, 1.0, 1.0, -0.8]) * self.rng.uniform(0.07, 0.2)) + 1.0
        r, g, b = (min(0.95, gain * (0.7 * channel + 0.3 * grey)) for channel in ground)
        return r, g, b

    def fill(self, ring_px: FloatArray, patch: int, date: Date = Date.BOTH) -> None:
        """Fill polygon ``(n, 2)`` with a patch on the dates given."""
        for raster in self.rasters(date):
            fill_ring(raster, ring_px, patch)

    def paint(self, mask: BoolArray, patch: int, date: Date = Date.BOTH) -> None:
        """Fill mask ``(h, w)`` with a patch on the dates given."""
        for raster in self.rasters(date):
            raster[mask] = patch

    def rasters(self, date: Date) -> list[NDArray[np.uint16]]:
        """Return the patch rasters of the dates given."""
        return [self.day] * bool(date & Date.DAY) + [self.night] * bool(date & Date.NIGHT)

    def materials(self, date: Date = Date.DAY) -> NDArray[np.uint8]:
        """Return the material ``(h, w)`` of one date, overlays included where they cover half."""
        table = np.array([patch.material for patch in self.patches], dtype=np.uint8)
        material: NDArray[np.uint8] = table[self.rasters(date)[0]]
        for overlay in self.overlays:
            material[overlay.layers(date)[0] > 127] = overlay.material
        return material


def new_scene(
    rng: np.random.Generator, shape: tuple[int, int], gsd_m: float, climate: Climate
) -> Scene:
    """Return an empty scene on flat ground; patch 0 (to be added first) covers all of it."""
    flat = np.zeros((2, *shape), dtype=np.float32)
    empty = np.zeros((2, *shape), dtype=np.uint16)
    moisture = fractal_noise(rng, shape, gsd_m, float(rng.uniform(80.0, 200.0)), roughness=0.6)
    return Scene(
        gsd_m, rng, climate, flat[0], flat[1], moisture, empty[0], empty[1], draw_night(rng)
    )


def fill_ring(
    raster: NDArray[np.integer[Any] | np.floating[Any]], ring_px: FloatArray, value: float
) -> None:
    """Fill polygon ``(n, 2)`` of float pixels in a raster, exact to 1/16 px."""
    fixed = np.round(ring_px * (1 << _SUBPIXEL_BITS)).astype(np.int32)
    cv2.fillPoly(raster, [fixed], float(value), lineType=cv2.LINE_8, shift=_SUBPIXEL_BITS)


def draw_lines(
    coverage: NDArray[np.uint8], lines_px: list[FloatArray], width_px: float, opacity: float = 1.0
) -> None:
    """Draw smooth-edged lines; those thinner than a pixel become fainter instead of thicker."""
    fixed = [np.round(line * (1 << _SUBPIXEL_BITS)).astype(np.int32) for line in lines_px]
    strength = opacity * min(1.0, max(width_px, 0.15))
    cv2.polylines(
        coverage,
        fixed,
        isClosed=False,
        color=round(255 * strength),
        thickness=max(1, round(width_px)),
        lineType=cv2.LINE_AA,
        shift=_SUBPIXEL_BITS,
    )
