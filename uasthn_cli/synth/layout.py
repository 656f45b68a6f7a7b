"""Plane geometry of things that people lay out: turned axes, plots, wandering lines."""

import math
from dataclasses import dataclass

import numpy as np

from uasthn_cli.types import FloatArray


@dataclass(frozen=True, slots=True)
class Axes:
    """Metre axes ``(u, v)`` on an image: origin in pixels, ``u`` turned from image x to image y."""

    origin_px: tuple[float, float]
    angle_rad: float
    gsd_m: float

    def to_px(self, points_m: FloatArray) -> FloatArray:
        """Map ``(u, v)`` metres ``(..., 2)`` to image pixels."""
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        rotation = np.array([[c, s], [-s, c]])
        turned: FloatArray = np.asarray(points_m, dtype=np.float64) @ rotation
        points_px: FloatArray = turned / self.gsd_m + np.asarray(self.origin_px)
        return points_px


@dataclass(frozen=True, slots=True)
class Plot:
    """An upright rectangle in metre axes."""

    u0_m: float
    v0_m: float
    u1_m: float
    v1_m: float

    @property
    def width_m(self) -> float:
        """Extent along u."""
        return self.u1_m - self.u0_m

    @property
    def length_m(self) -> float:
        """Extent along v."""
        return self.v1_m - self.v0_m

    def corners_m(self, inset_m: float = 0.0) -> FloatArray:
        """Return the ring of corners ``(4, 2)``, moved inwards by ``inset_m``."""
        d = min(inset_m, 0.45 * self.width_m, 0.45 * self.length_m)
        u0, v0, u1, v1 = self.u0_m + d, self.v0_m + d, self.u1_m - d, self.v1_m - d
        return np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]])


def divide(rng: np.random.Generator, plot: Plot, largest_m: float, smallest_m: float) -> list[Plot]:
    """Split a plot in two, again and again, until no side exceeds ``largest_m``.

    Some plots that could still be split are left whole, so that sizes vary.
    """
    longest = max(plot.width_m, plot.length_m)
    satisfied = longest < largest_m and rng.random() < 0.45
    if longest < 2.0 * smallest_m or satisfied:
        return [plot]
    share = float(rng.choice([0.5, 0.5, rng.uniform(0.3, 0.7)]))
    share = min(max(share, smallest_m / longest), 1.0 - smallest_m / longest)
    if plot.width_m >= plot.length_m:
        cut = plot.u0_m + share * plot.width_m
        halves = (
            Plot(plot.u0_m, plot.v0_m, cut, plot.v1_m),
            Plot(cut, plot.v0_m, plot.u1_m, plot.v1_m),
        )
    else:
        cut = plot.v0_m + share * plot.length_m
        halves = (
            Plot(plot.u0_m, plot.v0_m, plot.u1_m, cut),
            Plot(plot.u0_m, cut, plot.u1_m, plot.v1_m),
        )
    return [piece for half in halves for piece in divide(rng, half, largest_m, smallest_m)]


def wandering_line(
    rng: np.random.Generator,
    start_m: FloatArray,
    heading_rad: float,
    length_m: float,
    bend_rad: float,
) -> FloatArray:
    """Return a smooth line ``(n, 2)`` in metres whose heading wanders by about ``bend_rad``.

    The heading is an Ornstein-Uhlenbeck process over some 300 m of path.
    """
    step_m = max(length_m / 400.0, 4.0)
    count = max(2, math.ceil(length_m / step_m))
    decay = math.exp(-step_m / 300.0)
    kicks = rng.normal(0.0, bend_rad * math.sqrt(1.0 - decay**2), count)
    bends = np.empty(count)
    bends[0] = rng.normal(0.0, 0.5 * bend_rad)
    for k in range(1, count):
        bends[k] = decay * bends[k - 1] + kicks[k]
    width = max(1, round(60.0 / step_m))
    headings = heading_rad + np.convolve(bends, np.ones(width) / width, mode="same")
    steps = step_m * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return np.concatenate([start_m[None], start_m + np.cumsum(steps, axis=0)])
