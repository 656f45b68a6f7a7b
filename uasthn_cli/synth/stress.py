"""Make a healthy flight one that cannot, or can hardly, be placed, and keep what is still true.

The six failure cases of the paper (sec. IV-D) and the map of another place, each from 0 to 1.
"""

import csv
import io
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import cv2
import numpy as np

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.ingest.frames import list_frames
from uasthn_cli.outputs.truth import TrueFrame, read_truth
from uasthn_cli.synth import stress_maps
from uasthn_cli.synth.flight import render_flight
from uasthn_cli.synth.flight_config import FlightConfig, SensorConfig, StressConfig
from uasthn_cli.synth.flight_folder import (
    RenderedFlight,
    dem_in,
    flight_in,
    staged_flight,
)
from uasthn_cli.synth.kinds import StressCategory
from uasthn_cli.synth.repetition import draw_repetition
from uasthn_cli.synth.stress_frames import (
    Frame,
    badly_exposed,
    bent,
    blended,
    faded,
    retaken,
    shifted_corners_px,
)
from uasthn_cli.types import FloatArray, FrameFile

ON_MAP_COLUMN: Final = "on_map_share"
"""Column of ``truth.csv`` after ``beyond-map``: the share of a frame's footprint on the map."""

_CATEGORIES: Final = tuple(StressCategory)
_PLANE_ONLY: Final = (StressCategory.GEOMETRY, StressCategory.SELF_SIMILAR)
_WHOLE_MAP: Final = -1
_PATTERN_K: Final = 1.5
_SAMPLES: Final = 12


@dataclass(frozen=True, slots=True)
class _Stage:
    """A copy of the flight that is being changed in place."""

    flight: RenderedFlight
    frames: tuple[FrameFile, ...]
    truth: Mapping[str, TrueFrame]
    config: StressConfig

    def random(self, index: int = _WHOLE_MAP) -> np.random.Generator:
        """Return the random numbers of one frame, or of the map."""
        category = _CATEGORIES.index(self.config.category)
        return np.random.default_rng((self.config.seed, category, index + 1))

    @property
    def camera(self) -> SensorConfig:
        """The camera that takes frames anew."""
        return SensorConfig(pattern_seed=self.config.seed)


def stress_flight(
    source: Path, out: Path, config: StressConfig, *, overwrite: bool = False
) -> RenderedFlight:
    """Write a copy of the flight in ``source`` with one thing made wrong; the same bytes each time.

    Both are folders with ``flight.tlog``, ``frames/``, ``map.tif`` and ``truth.csv``. The truth
    stays true: corners follow the frames where those are bent. At severity 0 nothing changes.

    Raises:
        SyntheticFlightError: the flight lacks a part or a frame's truth, or cannot be changed so.
        OutputError: ``out`` exists already and ``overwrite`` is false, or cannot be written.
        UasthnError: a part of the flight, or a donor, cannot be read.
    """
    healthy = flight_in(source)
    missing = [path.name for path in _parts(healthy) if not path.exists()]
    if missing:
        raise SyntheticFlightError(f"{source} is no flight: {', '.join(missing)} missing")
    with staged_flight(out, overwrite=overwrite) as staging:
        _write_variant(healthy, staging, config)
    return flight_in(out)


def render_stressed_flight(
    out: Path,
    flight: FlightConfig,
    stress: StressConfig,
    *,
    overwrite: bool = False,
    on_frame: Callable[[int], None] | None = None,
) -> RenderedFlight:
    """Render a healthy flight out of sight, and write it with one thing made wrong.

    Raises:
        SyntheticFlightError: the flight cannot be rendered, or not be changed so.
        OutputError: ``out`` exists already and ``overwrite`` is false, or cannot be written.
    """
    if stress.category in _PLANE_ONLY and (flight.errors.relief_m or flight.errors.lens_k1):
        raise SyntheticFlightError(
            f"stress {stress.category} needs flat ground and no lens: leave both out"
        )
    with staged_flight(out, overwrite=overwrite) as staging, TemporaryDirectory() as scratch:
        healthy = render_flight(Path(scratch) / "healthy", flight, on_frame=on_frame)
        _write_variant(healthy, staging, stress)
    return flight_in(out)


def _write_variant(healthy: RenderedFlight, staging: RenderedFlight, config: StressConfig) -> None:
    """Copy a flight, and change the copy."""
    shutil.copytree(healthy.frames, staging.frames, dirs_exist_ok=True)
    for original, copy in zip(_parts(healthy), _parts(staging), strict=True):
        if original.is_file():
            shutil.copyfile(original, copy)
    if healthy.dem is not None:
        shutil.copyfile(healthy.dem, dem_in(staging.map.parent))
    if config.severity > 0.0:
        _CHANGES[config.category](_staged(staging, config))


def _parts(flight: RenderedFlight) -> tuple[Path, ...]:
    return flight.map, flight.frames, flight.log, flight.truth


def _staged(flight: RenderedFlight, config: StressConfig) -> _Stage:
    """List a copied flight's frames, all of which need their truth."""
    frames = tuple(list_frames(flight.frames))
    truth = read_truth(flight.truth).frames
    unknown = [frame.name for frame in frames if frame.name not in truth]
    if unknown:
        raise SyntheticFlightError(f"truth.csv has no row for frame {unknown[0]!r}: add it")
    return _Stage(flight, frames, truth, config)


def _fade(stage: _Stage) -> None:
    for index, frame in enumerate(stage.frames):
        image = _read(frame)
        changed = faded(image, stage.config.severity, stage.random(index), stage.camera)
        _write(frame, changed)


def _expose_badly(stage: _Stage) -> None:
    for index, frame in enumerate(stage.frames):
        _write(frame, badly_exposed(_read(frame), stage.config.severity, stage.random(index)))


def _bend(stage: _Stage) -> None:
    """Bend the frames, and move their true corners and centres along."""
    cells = {}
    for index, frame in enumerate(stage.frames):
        image = _read(frame)
        height_px, width_px = image.shape
        size_px = (width_px, height_px)
        corners_px = shifted_corners_px(size_px, stage.config.severity, stage.random(index))
        _write(frame, bent(image, corners_px))
        cells[frame.name] = _truth_cells(stage.truth[frame.name], size_px, corners_px)
    _change_truth(stage.flight.truth, cells)


def _repeat(stage: _Stage) -> None:
    """Show one pattern without landmarks on the map, and in the frames what they see of it."""
    severity = stage.config.severity
    image = stress_maps.read_map(stage.flight.map)
    rng = stage.random()
    repetition = draw_repetition(rng, _footprint_m(stage, image))
    for index, frame in enumerate(stage.frames):
        healthy = _read(frame)
        points_m = _seen_px(healthy, stage.truth[frame.name], image) * image.pixel_m
        warmth_k = np.float32(_PATTERN_K) * repetition.night(points_m)
        pattern = retaken(warmth_k, healthy, stage.random(index), stage.camera)
        _write(frame, blended(healthy, pattern, severity))
    changed = stress_maps.repeated(image, repetition, severity, rng)
    stress_maps.write_changed_map(stage.flight.map, changed)


def _cut_map(stage: _Stage) -> None:
    """Cut the map, and note in the truth how much of each frame it still shows."""
    image = stress_maps.read_map(stage.flight.map)
    corners_px = np.stack(
        [image.place.to_pixels(stage.truth[frame.name].corners_deg) for frame in stage.frames]
    )
    seen_px = _samples_px(corners_px)
    cut, on_map = stress_maps.cut_off(image, seen_px, stage.config.severity, stage.random())
    stress_maps.write_changed_map(stage.flight.map, cut)
    shares = zip(stage.frames, on_map, strict=True)
    _change_truth(
        stage.flight.truth, {frame.name: {ON_MAP_COLUMN: f"{share:.4f}"} for frame, share in shares}
    )


def _outdate(stage: _Stage) -> None:
    image = stress_maps.read_map(stage.flight.map)
    changed = stress_maps.outdated(
        image,
        stage.config.severity,
        stage.random(),
        patch_m=_footprint_m(stage, image),
        donors=stage.config.donors,
    )
    stress_maps.write_changed_map(stage.flight.map, changed)


def _misplace(stage: _Stage) -> None:
    image = stress_maps.read_map(stage.flight.map)
    other = stress_maps.of_another_place(image, stage.random(), stage.config.donors)
    stress_maps.write_changed_map(stage.flight.map, other)


_CHANGES: Final[Mapping[StressCategory, Callable[[_Stage], None]]] = {
    StressCategory.TEXTURELESS: _fade,
    StressCategory.EXPOSURE: _expose_badly,
    StressCategory.GEOMETRY: _bend,
    StressCategory.SELF_SIMILAR: _repeat,
    StressCategory.BEYOND_MAP: _cut_map,
    StressCategory.OUTDATED: _outdate,
    StressCategory.WRONG_PLACE: _misplace,
}


def _footprint_m(stage: _Stage, image: stress_maps.MapImage) -> float:
    """Return how wide the first frame is on the ground."""
    corners_px = image.place.to_pixels(stage.truth[stage.frames[0].name].corners_deg)
    return float(np.linalg.norm((corners_px[1] - corners_px[0]) * image.pixel_m))


def _seen_px(frame: Frame, true: TrueFrame, image: stress_maps.MapImage) -> FloatArray:
    """Return the map pixels ``(h, w, 2)`` that a frame's pixels show."""
    height_px, width_px = frame.shape
    H_frame_map = homography_from_corners(
        image_corners_px(width_px, height_px), image.place.to_pixels(true.corners_deg)
    )
    columns, rows = np.meshgrid(np.arange(float(width_px)), np.arange(float(height_px)))
    points = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    return transform_points(H_frame_map, points).reshape(height_px, width_px, 2)


def _samples_px(corners_px: FloatArray) -> FloatArray:
    """Return points ``(frames, n, 2)`` spread over quadrilaterals ``(frames, 4, 2)``."""
    steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    square = np.array([(x, y) for y in steps for x in steps])
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    return transform_points(homography_from_corners(unit, corners_px), square[None])


def _truth_cells(
    true: TrueFrame, size_px: tuple[int, int], corners_px: FloatArray
) -> dict[str, str]:
    """Return the cells of ``truth.csv`` for a frame that shows what lies between ``corners_px``."""
    local = LocalFrame(*true.center_deg)
    corners = image_corners_px(*size_px)
    H_frame_ground = homography_from_corners(corners, local.to_metres(true.corners_deg))
    H_bent_ground = H_frame_ground @ homography_from_corners(corners, corners_px)
    middle = corners.mean(axis=0, keepdims=True)
    places = local.to_degrees(transform_points(H_bent_ground, np.concatenate([middle, corners])))
    names = ("center", "tl", "tr", "bl", "br")
    return {
        f"{name}_{axis}": f"{value:.8f}"
        for name, place in zip(names, places, strict=True)
        for axis, value in zip(("lat", "lon"), place, strict=True)
    }


def _change_truth(path: Path, cells: Mapping[str, Mapping[str, str]]) -> None:
    """Replace or add cells of ``truth.csv`` by frame; all others stay to the letter."""
    with path.open(encoding="utf-8-sig", newline="") as handle:
        reader = csv.DictReader(handle)
        columns, rows = list(reader.fieldnames or ()), list(reader)
    columns += [name for name in next(iter(cells.values())) if name not in columns]
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(row | dict(cells.get(row["frame"], {})) for row in rows)
    path.write_text(text.getvalue(), encoding="utf-8")


def _read(frame: FrameFile) -> Frame:
    """Read a frame in its own depth, colour as grey."""
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imread(str(frame.path), flags)
    if image is None:
        raise SyntheticFlightError(f"frames/{frame.name} cannot be read: take it out of the flight")
    return np.asarray(image)


def _write(frame: FrameFile, image: Frame) -> None:
    """Write a frame back in its own format."""
    _, encoded = cv2.imencode(frame.path.suffix, image)
    frame.path.write_bytes(encoded.tobytes())
