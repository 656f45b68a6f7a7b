"""Sand dunes: gentle windward slopes, sharp crests, slip faces at the angle of repose."""

import math

import cv2
import numpy as np

from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.types import ImageArray


def dune_field(
    rng: np.random.Generator,
    shape: tuple[int, int],
    gsd_m: float,
    *,
    spacing_m: float,
    wind_rad: float,
) -> ImageArray:
    """Return dunes ``(h, w)`` in metres, ``spacing_m`` apart, wind towards ``wind_rad`` (image).

    Two or three sizes of dune, each a noise stretched across the wind and steepened like a
    shallow wave (Burgers' equation: the crest overtakes the trough), which gives sinuous,
    branching crests with slip faces on one side.
    """
    total = np.zeros(shape, dtype=np.float32)
    scale_m = spacing_m
    strength = 1.0
    while scale_m > 3.0 * gsd_m and strength > 0.2:
        turned = wind_rad + float(rng.normal(0.0, 0.25))
        waves = _stretched_noise(rng, shape, gsd_m, scale_m, turned)
        presence = 1.0 / (1.0 + np.exp(-2.0 * fractal_noise(rng, shape, gsd_m, 6.0 * scale_m)))
        height_m = (0.035 * strength * scale_m) * waves * (0.35 + presence)
        total += _steepened(height_m, gsd_m, scale_m, turned)
        scale_m *= float(rng.uniform(0.3, 0.45))
        strength *= float(rng.uniform(0.5, 0.75))
    return smooth(total, 0.4 / gsd_m)


def _stretched_noise(
    rng: np.random.Generator,
    shape: tuple[int, int],
    gsd_m: float,
    spacing_m: float,
    wind_rad: float,
) -> ImageArray:
    """Return noise whose crests run across the wind, longer than wide, bent by a slower noise."""
    height, width = shape
    stretch = float(rng.uniform(1.8, 3.5))
    reach = math.hypot(height, width)
    side_px = math.ceil(reach) + 8
    canvas = fractal_noise(
        rng,
        (math.ceil(side_px / stretch) + 8, side_px),
        gsd_m,
        1.1 * spacing_m,
        roughness=0.45,
        finest_m=0.12 * spacing_m,
    )
    bend = fractal_noise(rng, shape, gsd_m, 5.0 * spacing_m, roughness=0.5)
    bend *= 0.35 * spacing_m / gsd_m
    y, x = np.indices(shape, dtype=np.float32)
    x -= 0.5 * width
    y -= 0.5 * height
    c, s = math.cos(wind_rad), math.sin(wind_rad)
    along = c * x + s * y + bend + 0.5 * canvas.shape[1]
    across = (-s * x + c * y) / stretch + 0.5 * canvas.shape[0]
    return np.asarray(
        cv2.remap(canvas, along, across, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101),
        dtype=np.float32,
    )


def _steepened(height_m: ImageArray, gsd_m: float, spacing_m: float, wind_rad: float) -> ImageArray:
    """Push high sand downwind until the lee side slips."""
    rise = float(height_m.std()) + 1e-6
    push_px = 0.15 * spacing_m / gsd_m / rise
    y, x = np.indices(height_m.shape, dtype=np.float32)
    c, s = math.cos(wind_rad), math.sin(wind_rad)
    moved = height_m
    for _ in range(3):
        shift = push_px * moved
        moved = np.asarray(
            cv2.remap(
                height_m,
                x - c * shift,
                y - s * shift,
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REFLECT_101,
            ),
            dtype=np.float32,
        )
    return smooth(moved, max(0.6, 0.015 * spacing_m / gsd_m))
