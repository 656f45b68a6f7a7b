"""A procedural place seen twice: by day from space in colour, by night in the thermal infrared."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.synth.kinds import LandscapeKind
from uasthn_cli.synth.recipes import build_scene
from uasthn_cli.synth.satellite import draw_daylight, satellite_image
from uasthn_cli.synth.thermal import draw_night_sky, night_temperature
from uasthn_cli.types import ImageArray

__all__ = ["Landscape", "LandscapeKind", "render_landscape"]


@dataclass(frozen=True, slots=True)
class Landscape:
    """One place on one pixel grid (x east, y south, ``gsd_m`` metres a pixel).

    ``rgb`` ``(h, w, 3)`` is the satellite image; ``temperature`` ``(h, w)`` float32 the apparent
    temperature in kelvin on a later night; ``height_m`` ``(h, w)`` the bare ground; ``material``
    ``(h, w)`` the :class:`~uasthn_cli.synth.materials.Material` on the satellite's date.
    """

    rgb: NDArray[np.uint8]
    height_m: ImageArray
    temperature: ImageArray
    material: NDArray[np.uint8]
    gsd_m: float


def render_landscape(
    seed: int,
    size_px: tuple[int, int],
    gsd_m: float,
    *,
    kind: LandscapeKind | None = None,
) -> Landscape:
    """Render the place that a seed stands for at ``size_px`` (width, height).

    The same arguments give the same bytes. Another size or GSD gives another place.

    Raises:
        ValueError: the size or the GSD is not positive.
    """
    width, height = size_px
    if min(width, height) < 16 or not gsd_m > 0.0:
        raise ValueError(f"cannot render {width} × {height} px at {gsd_m} m/px")
    rng = np.random.default_rng(seed)
    drawn = list(LandscapeKind)[int(rng.integers(len(LandscapeKind)))]
    scene = build_scene(rng, (height, width), gsd_m, kind or drawn)
    rgb = satellite_image(scene, draw_daylight(rng))
    temperature = night_temperature(scene, draw_night_sky(rng))
    return Landscape(rgb, scene.ground_m, temperature, scene.materials(), gsd_m)
