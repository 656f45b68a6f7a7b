"""Roads and tracks: paved roads with verges, straight section roads, wandering desert tracks."""

import math

import numpy as np

from uasthn_cli.synth.layout import wandering_line
from uasthn_cli.synth.materials import Material
from uasthn_cli.synth.scene import Date, Overlay, Scene, draw_lines
from uasthn_cli.types import FloatArray

MARGIN_M = 150.0


def wandering_tracks(scene: Scene, overlay: Overlay, count: int, bend_rad: float) -> None:
    """Draw tracks across the scene; about one in eight is there on one date only."""
    for _ in range(count):
        line = _crossing(scene, bend_rad)
        chance = scene.rng.random()
        date = Date.DAY if chance < 0.06 else Date.NIGHT if chance < 0.12 else Date.BOTH
        track(scene, overlay, line, date, float(scene.rng.uniform(2.5, 5.5)))


def track(scene: Scene, overlay: Overlay, line_px: FloatArray, date: Date, width_m: float) -> None:
    """Draw one track: worn ground, fainter or clearer, with side strands."""
    for _ in range(int(scene.rng.integers(0, 3))):
        side_m = float(scene.rng.uniform(1.0, 2.5)) * width_m
        strand = line_px + _sidestep(scene, line_px, side_m)
        for coverage in overlay.layers(date):
            draw_lines(coverage, [strand], 0.4 * width_m / scene.gsd_m, 0.5)
    opacity = float(scene.rng.uniform(0.5, 1.0))
    for coverage in overlay.layers(date):
        draw_lines(coverage, [line_px], width_m / scene.gsd_m, opacity)


def paved_road(scene: Scene, line_px: FloatArray, width_m: float) -> None:
    """Draw a paved road on a verge of packed earth."""
    verge, paved = ground_overlay(scene, Material.TRACK), ground_overlay(scene, Material.PAVED)
    for date in (Date.DAY, Date.NIGHT):
        for coverage in verge.layers(date):
            draw_lines(coverage, [line_px], (width_m + 5.0) / scene.gsd_m, 0.6)
        for coverage in paved.layers(date):
            draw_lines(coverage, [line_px], width_m / scene.gsd_m)


def crossing_roads(scene: Scene, count: int) -> None:
    """Draw paved roads that cross the scene in wide bends."""
    for _ in range(count):
        paved_road(scene, _crossing(scene, 0.25), float(scene.rng.uniform(6.0, 11.0)))


def ground_overlay(scene: Scene, material: Material) -> Overlay:
    """Return the scene's overlay of a kind of road, made on first use."""
    for overlay in scene.overlays:
        if overlay.material is material:
            return overlay
    return scene.new_overlay(material)


def _crossing(scene: Scene, bend_rad: float) -> FloatArray:
    """Return a line in pixels from beyond the edge through a random point near the middle."""
    width_m, height_m = scene.extent_m
    through = scene.rng.uniform((0.1, 0.1), (0.9, 0.9)) * (width_m, height_m)
    heading = float(scene.rng.uniform(0.0, 2.0 * math.pi))
    reach_m = math.hypot(width_m, height_m) + MARGIN_M
    halves = [
        wandering_line(scene.rng, through, heading + turn, reach_m, bend_rad)
        for turn in (0.0, math.pi)
    ]
    line: FloatArray = np.concatenate([halves[0][::-1], halves[1][1:]]) / scene.gsd_m
    return line


def _sidestep(scene: Scene, line_px: FloatArray, distance_m: float) -> FloatArray:
    """Return small shifts ``(n, 2)`` that carry a strand beside its line and back."""
    direction = np.gradient(line_px, axis=0)
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
    places = np.linspace(0.0, scene.rng.uniform(6.0, 20.0), len(line_px))
    wave = np.sin(places + scene.rng.uniform(0.0, 2.0 * math.pi))
    return normal * (wave * distance_m / scene.gsd_m)[:, None]
