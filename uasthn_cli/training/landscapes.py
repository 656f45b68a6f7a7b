"""Rendered landscapes as training scenes: night temperature that is no function of colour."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.synth.kinds import LandscapeKind
from uasthn_cli.synth.landscape import render_landscape
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.fields import resize_square, standardise
from uasthn_cli.training.pseudo_thermal import thermal_from_colour
from uasthn_cli.types import ImageArray

LANDSCAPES = 200
"""How many landscapes a worker renders and keeps."""

LANDSCAPE_PX = 800
_SEED = 7_000_000
_MIN_GSD_M, _MAX_GSD_M = 0.3, 10.0
_MIDDLE_GSD_M = (_MIN_GSD_M * _MAX_GSD_M) ** 0.5
_COLOUR_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class RenderedLandscape:
    """Landscape number ``index``, rendered when first needed; kinds and GSDs take turns."""

    index: int

    @property
    def shape_px(self) -> tuple[int, int]:
        """Height and width."""
        return LANDSCAPE_PX, LANDSCAPE_PX

    def identity(self) -> bytes:
        """Return which landscape this is."""
        return f"landscape {self.index}".encode()

    def render(
        self,
        rng: np.random.Generator,
        row_px: int,
        column_px: int,
        length_px: int,
        size_px: int,
        engine: EngineConfig,
    ) -> tuple[ImageArray, list[ImageArray]]:
        """Return the map by day and two views by night, each with some of the colours mixed in."""
        gsd_m = _gsd_m(self.index) if engine.scale_range else _MIDDLE_GSD_M
        rgb, temperature = _landscape(self.index, gsd_m)
        rows, columns = slice(row_px, row_px + length_px), slice(column_px, column_px + length_px)
        colour = resize_square(rgb[rows, columns].astype(np.float32) / 255, size_px)
        night = standardise(resize_square(temperature[rows, columns].astype(np.float32), size_px))
        thermals = []
        for _ in range(2):
            view = night
            if rng.random() < _COLOUR_SHARE:
                view = view + rng.uniform(0.0, 1.0) * thermal_from_colour(rng, colour, engine)
            thermals.append(np.asarray(view, np.float32))
        return colour, thermals


@lru_cache(maxsize=LANDSCAPES)
def _landscape(index: int, gsd_m: float) -> tuple[NDArray[np.uint8], NDArray[np.float16]]:
    """Return colour ``(n, n, 3)`` and standardised temperature ``(n, n)``, in little memory."""
    kinds = list(LandscapeKind)
    place = render_landscape(
        _SEED + index, (LANDSCAPE_PX, LANDSCAPE_PX), gsd_m, kind=kinds[index % len(kinds)]
    )
    return place.rgb, standardise(place.temperature).astype(np.float16)


def _gsd_m(index: int) -> float:
    """Return the GSD of a landscape, evenly spread on a logarithmic scale."""
    rng = np.random.default_rng([_SEED, index])
    return float(np.exp(rng.uniform(np.log(_MIN_GSD_M), np.log(_MAX_GSD_M))))
