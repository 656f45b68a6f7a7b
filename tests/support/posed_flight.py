"""A flight whose frames are seen at an angle, rendered ray by ray: an oracle for placement.

It shares no geometry with the package: attitudes are turned by SciPy, rays meet flat ground.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rasterio.warp import transform as warp_points
from scipy.spatial.transform import Rotation
from small_flight import (
    MAP_CRS,
    MAP_GSD_M,
    NORTH_M,
    START_UTC_S,
    WEST_M,
    ground_texture,
    write_map,
)

from uasthn_cli.config import GeotagConfig
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.ingest.mavlink import TlogWriter
from uasthn_cli.pipeline import GeotagJob, Run, open_run
from uasthn_cli.seam import Estimator
from uasthn_cli.types import FrameResult

FloatArray = NDArray[np.float64]

HFOV_DEG = 50.0
SEARCH_RADIUS_M = 30.0
SIZE_PX = (120, 88)
INTERVAL_S = 4.0
BOOT_BEFORE_START_S = 10.0
TAKE_OFF_AMSL_M = 50.0


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a frame was taken: metres east and south of the map's corner, metres up, degrees.

    ``prior_error_m`` is how far east and south of it the log says it was; ``logged_pitch_deg`` and
    ``logged_height_m`` what the log says where it errs.
    """

    east_m: float
    south_m: float
    height_m: float = 100.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    prior_error_m: tuple[float, float] = (14.0, -9.0)
    logged_pitch_deg: float | None = None
    logged_height_m: float | None = None


POSES = (
    Pose(170.0, 150.0),
    Pose(200.0, 160.0, yaw_deg=90.0),
    Pose(230.0, 180.0, 96.0, roll_deg=6.0, pitch_deg=-4.0, yaw_deg=37.0),
    Pose(215.0, 200.0, 104.0, roll_deg=-8.0, pitch_deg=5.0, yaw_deg=-160.0),
    Pose(180.0, 190.0, 100.0, pitch_deg=9.0, yaw_deg=250.0),
)


@dataclass(frozen=True, slots=True)
class LogFaults:
    """What stays wrong throughout a log: what is to be added to times, headings and heights.

    Frames are stamped ``clock_s`` before they were taken, ``yaw_deg`` is missing from the logged
    heading, and the height is to be multiplied by ``height_factor``.
    """

    clock_s: float = 0.0
    yaw_deg: float = 0.0
    height_factor: float = 1.0


@dataclass(frozen=True, slots=True)
class PosedFlight:
    """Paths of a flight's inputs, and the poses of its frames in order."""

    log: Path
    frames: Path
    map: Path
    poses: tuple[Pose, ...]
    mount_yaw_deg: float = 0.0

    @property
    def names(self) -> list[str]:
        """Return the frames' names in order of their poses."""
        return [frame_name(index) for index in range(len(self.poses))]


def ground_m(pose: Pose, pixels: FloatArray, mount_yaw_deg: float = 0.0) -> FloatArray:
    """Return where rays through pixels ``(n, 2)`` meet the ground, metres east and south."""
    width, height = SIZE_PX
    focal = width / 2 / math.tan(math.radians(HFOV_DEG / 2))
    right = (pixels[:, 0] - (width - 1) / 2) / focal
    down = (pixels[:, 1] - (height - 1) / 2) / focal
    camera = np.stack([-down, right, np.ones(len(pixels))], axis=1)  # forward, right, down
    angles = [pose.yaw_deg, pose.pitch_deg, pose.roll_deg]
    ned = Rotation.from_euler("ZYX", angles, degrees=True) * Rotation.from_euler(
        "Z", mount_yaw_deg, degrees=True
    )
    rays = ned.apply(camera)
    scale = pose.height_m / rays[:, 2]
    return np.stack([pose.east_m + rays[:, 1] * scale, pose.south_m - rays[:, 0] * scale], axis=1)


def corner_pixels() -> FloatArray:
    """Return the centres of the frame's corner pixels."""
    right, bottom = SIZE_PX[0] - 1.0, SIZE_PX[1] - 1.0
    return np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])


def degrees(points_m: FloatArray) -> FloatArray:
    """Map metres east and south of the map's corner ``(n, 2)`` to ``(lat, lon)``."""
    xs, ys = WEST_M + points_m[:, 0], NORTH_M - points_m[:, 1]
    lon, lat = warp_points(MAP_CRS, "EPSG:4326", xs, ys)
    return np.stack([lat, lon], axis=-1)


def see(ground: NDArray[np.uint8], pose: Pose, mount_yaw_deg: float = 0.0) -> NDArray[np.uint8]:
    """Return the frame ``(h, w)`` that shows the ground from a pose."""
    width, height = SIZE_PX
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64)
    columns_rows = (ground_m(pose, pixels, mount_yaw_deg) / MAP_GSD_M - 0.5).astype(np.float32)
    map_x, map_y = columns_rows.reshape(height, width, 2).transpose(2, 0, 1)
    return np.asarray(cv2.remap(ground, map_x, map_y, cv2.INTER_LINEAR), np.uint8)


def frame_name(index: int) -> str:
    """Return a frame's name, which tells its time in milliseconds."""
    return f"frame_{round(1000 * (START_UTC_S + 2.0 + index * INTERVAL_S))}.png"


def write_log(
    path: Path,
    poses: tuple[Pose, ...],
    fly_on_s: float = 2.0,
    faults: LogFaults | None = None,
) -> None:
    """Write a log at 5 Hz that holds each attitude and height while its frame is taken.

    So it does the positions, unless there are ``faults``: then the aircraft flies from one to the
    next.
    """
    duration_s = 2.0 + (len(poses) - 1) * INTERVAL_S + fly_on_s
    still = dict.fromkeys(("rollspeed", "pitchspeed", "yawspeed"), 0.0)
    wrong = faults or LogFaults()
    places_m = np.array([[pose.east_m, pose.south_m] for pose in poses])
    places_m = places_m + [pose.prior_error_m for pose in poses]
    with TlogWriter(path) as log:
        for time_s in np.arange(0.0, duration_s, 0.2):
            step = np.clip((time_s - 2.0) / INTERVAL_S, 0, len(poses) - 1)
            index = round(step)
            pose = poses[index]
            place_m = places_m[index] if faults is None else _between(places_m, step)
            lat, lon = degrees(place_m[None])[0]
            height_m = _either(pose.logged_height_m, pose.height_m) / wrong.height_factor
            pitch_deg = _either(pose.logged_pitch_deg, pose.pitch_deg)
            utc_s = START_UTC_S + time_s + wrong.clock_s
            boot = {"time_boot_ms": round(1000 * (BOOT_BEFORE_START_S + time_s))}
            angles = {
                "roll": math.radians(pose.roll_deg),
                "pitch": math.radians(pitch_deg),
                "yaw": math.remainder(math.radians(pose.yaw_deg - wrong.yaw_deg), 2 * math.pi),
            }
            log.write(utc_s, "ATTITUDE", **boot, **angles, **still)
            log.write(
                utc_s,
                "GLOBAL_POSITION_INT",
                **boot,
                lat=round(lat * 1e7),
                lon=round(lon * 1e7),
                alt=round(1000 * (height_m + TAKE_OFF_AMSL_M)),
                relative_alt=round(1000 * height_m),
                vx=0,
                vy=0,
                vz=0,
                hdg=0,
            )


def _between(places_m: FloatArray, step: float) -> FloatArray:
    """Return the place on the way from one of ``(n, 2)`` places to the next."""
    steps = np.arange(len(places_m))
    return np.array([np.interp(step, steps, axis) for axis in places_m.T])


def _either(logged: float | None, true: float) -> float:
    return true if logged is None else logged


@contextmanager
def opened(
    flight: PosedFlight, estimator: Estimator | None = None, **settings: Any
) -> Iterator[Run]:
    """Open a flight with NCC; ``settings`` are those of :class:`GeotagConfig`."""
    chosen: dict[str, Any] = {"estimator": "ncc", "search_radius_m": SEARCH_RADIUS_M} | settings
    job = GeotagJob(
        log_path=flight.log,
        frames_path=flight.frames,
        map_path=flight.map,
        camera=CameraSpec(hfov_deg=HFOV_DEG, mount_yaw_deg=flight.mount_yaw_deg),
        config=GeotagConfig(**chosen),
    )
    with open_run(job, estimator) as run:
        yield run


def alone(run: Run) -> list[FrameResult]:
    """Return what each frame gave alone, in frame order."""
    return [entry.result for entry in run.locate()]


def make_posed_flight(
    folder: Path,
    poses: tuple[Pose, ...] = POSES,
    mount_yaw_deg: float = 0.0,
    faults: LogFaults | None = None,
) -> PosedFlight:
    """Render a flight whose frames show exactly what the map shows, in grey."""
    folder.mkdir(parents=True, exist_ok=True)
    ground = ground_texture(8)
    paths = (folder / "flight.tlog", folder / "frames", folder / "map.tif")
    flight = PosedFlight(*paths, poses, mount_yaw_deg)
    write_map(flight.map, np.stack([ground] * 3))
    flight.frames.mkdir()
    for name, pose in zip(flight.names, poses, strict=True):
        cv2.imwrite(str(flight.frames / name), see(ground, pose, mount_yaw_deg))
    write_log(flight.log, poses, faults=faults)
    return flight
