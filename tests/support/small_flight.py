"""A small flight that the command tests share: textured ground, its map, frames and log."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.transform import from_origin
from rasterio.warp import transform as warp_points

from uasthn_cli.ingest.mavlink import TlogWriter

HFOV_DEG = 45.0
HEIGHT_M = 100.0
FRAME_SIZE_PX = (96, 80)
FRAME_GSD_M = 2.0 * HEIGHT_M * math.tan(math.radians(HFOV_DEG) / 2.0) / FRAME_SIZE_PX[0]
MAP_SIZE_PX = (400, 360)
MAP_GSD_M = 1.0
MAP_CRS = "EPSG:32640"
WEST_M, NORTH_M = 499_800.0, 2_654_200.0
START_UTC_S = 1_763_800_000.0
FRAME_INTERVAL_S = 2.0
DRIFT_M = 12.0
"""How far east of the truth the logged positions lie."""


@dataclass(frozen=True, slots=True)
class Flight:
    """Paths of one flight's inputs, and what was rendered into them."""

    log: Path
    frames: Path
    map: Path
    truth: Path
    ground: NDArray[np.uint8]

    @property
    def names(self) -> list[str]:
        """Return the frames' file names in order."""
        return sorted(path.name for path in self.frames.iterdir())

    def arguments(self, out: Path, *extra: str) -> list[str]:
        """Return the command line that geo-tags the flight without network weights."""
        inputs = [str(self.log), str(self.frames), "--map", str(self.map), "--out", str(out)]
        search = ["--hfov", str(HFOV_DEG), "--estimator", "ncc", "--search-radius", "40"]
        return ["geotag", *inputs, *search, *extra]


def ground_texture(seed: int = 0) -> NDArray[np.uint8]:
    """Return a grey picture of the ground with structure at every scale."""
    random = np.random.default_rng(seed)
    width, height = MAP_SIZE_PX
    picture: NDArray[np.float64] = np.zeros((height, width))
    for sigma in (2.0, 5.0, 12.0, 30.0):
        layer = cv2.GaussianBlur(random.standard_normal((height, width)), (0, 0), sigma)
        picture += layer / layer.std()
    return np.asarray(np.clip(128.0 + 40.0 * picture / picture.std(), 0, 255), np.uint8)


def write_map(path: Path, bands: NDArray[np.generic], crs: str | None = MAP_CRS) -> None:
    """Write ``(bands, h, w)`` as a GeoTIFF in its place."""
    transform = from_origin(WEST_M, NORTH_M, MAP_GSD_M, MAP_GSD_M)
    count, height, width = bands.shape
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=width,
        height=height,
        count=count,
        dtype=bands.dtype,
        crs=crs,
        transform=transform,
    ) as raster:
        raster.write(bands)


def centers_m(count: int) -> NDArray[np.float64]:
    """Return the true ground points below the camera ``(count, 2)``, metres from the map corner."""
    east = np.linspace(140.0, 260.0, count)
    return np.stack([east, np.full(count, 170.0) + 20.0 * np.sin(east / 30.0)], axis=-1)


def _degrees(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map metres east and south of the map's corner ``(n, 2)`` to ``(lat, lon)``."""
    xs, ys = WEST_M + points_m[:, 0], NORTH_M - points_m[:, 1]
    lon, lat = warp_points(MAP_CRS, "EPSG:4326", xs, ys)
    return np.stack([lat, lon], axis=-1)


def _write_frames(folder: Path, ground: NDArray[np.uint8], count: int) -> None:
    """Write nadir, north-up frames, named by their time in milliseconds."""
    width, height = FRAME_SIZE_PX
    gsd_px = FRAME_GSD_M / MAP_GSD_M
    folder.mkdir()
    for k, (east, south) in enumerate(centers_m(count)):
        shift_x = east / MAP_GSD_M - 0.5 - gsd_px * (width - 1) / 2.0
        shift_y = south / MAP_GSD_M - 0.5 - gsd_px * (height - 1) / 2.0
        map_from_frame = np.array([[gsd_px, 0.0, shift_x], [0.0, gsd_px, shift_y]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        frame = cv2.warpAffine(ground, map_from_frame, FRAME_SIZE_PX, flags=flags)
        milliseconds = round(1000 * (START_UTC_S + 2.0 + k * FRAME_INTERVAL_S))
        cv2.imwrite(str(folder / f"frame_{milliseconds}.png"), 255 - frame)


def _write_truth(path: Path, names: list[str]) -> None:
    """Write the true centre and corners of each frame."""
    width, height = FRAME_SIZE_PX
    half_m = FRAME_GSD_M * np.array([width - 1.0, height - 1.0]) / 2.0
    columns = ["frame", "lat", "lon", "center_lat", "center_lon"]
    corners = [f"{corner}_{axis}" for corner in ("tl", "tr", "bl", "br") for axis in ("lat", "lon")]
    signs = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
    with path.open("w", newline="") as handle:
        writer = csv.writer(handle)
        writer.writerow([*columns, *corners])
        for name, center in zip(names, centers_m(len(names)), strict=True):
            points = _degrees(np.stack([center, center, *(center + signs * half_m)]))
            writer.writerow([name, *points.ravel()])


def write_log(path: Path, count: int, with_position: bool = True) -> None:
    """Write a telemetry log at 5 Hz: heartbeat, attitude, position."""
    times_s = np.arange(0.0, 4.1 + (count - 1) * FRAME_INTERVAL_S, 0.2)
    frame_times_s = 2.0 + FRAME_INTERVAL_S * np.arange(count)
    track = np.stack([np.interp(times_s, frame_times_s, axis) for axis in centers_m(count).T], -1)
    degrees = _degrees(track + np.array([DRIFT_M, 0.0]))
    level = dict.fromkeys(("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"), 0.0)
    still = {"vx": 500, "vy": 0, "vz": 0, "hdg": 0}
    heartbeat = {"type": 1, "autopilot": 3, "base_mode": 81, "custom_mode": 0}
    heartbeat |= {"system_status": 4, "mavlink_version": 3}
    heights = {"alt": round(1000 * HEIGHT_M) + 50_000, "relative_alt": round(1000 * HEIGHT_M)}
    with TlogWriter(path) as log:
        for time_s, (lat, lon) in zip(times_s, degrees, strict=True):
            utc_s, boot = START_UTC_S + time_s, {"time_boot_ms": round(10_000 + 1000 * time_s)}
            log.write(utc_s, "HEARTBEAT", **heartbeat)
            log.write(utc_s, "ATTITUDE", **boot, **level)
            if with_position:
                place = {"lat": round(lat * 1e7), "lon": round(lon * 1e7)}
                log.write(utc_s, "GLOBAL_POSITION_INT", **boot, **place, **heights, **still)


def make_flight(folder: Path, count: int = 4) -> Flight:
    """Render a flight of ``count`` frames into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    ground = ground_texture()
    flight = Flight(
        log=folder / "flight.tlog",
        frames=folder / "frames",
        map=folder / "map.tif",
        truth=folder / "truth.csv",
        ground=ground,
    )
    write_map(flight.map, np.stack([ground] * 3))
    _write_frames(flight.frames, ground, count)
    _write_truth(flight.truth, flight.names)
    write_log(flight.log, count)
    return flight
