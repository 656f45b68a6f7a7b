"""Render a flight with known truth: ``map.tif``, ``frames/``, ``flight.tlog``, ``truth.csv``."""

import csv
import io
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.synth.exposures import (
    Exposure,
    Stream,
    camera_of,
    plan_exposures,
    random_stream,
)
from uasthn_cli.synth.flight_config import FlightConfig
from uasthn_cli.synth.flight_folder import RenderedFlight, flight_in, staged_flight
from uasthn_cli.synth.flight_log import LogBook
from uasthn_cli.synth.landscape import render_landscape
from uasthn_cli.synth.map_raster import Ground, write_map
from uasthn_cli.synth.noise import smooth
from uasthn_cli.synth.sensor import render_sensor
from uasthn_cli.synth.trajectory import Trajectory, navigation_error
from uasthn_cli.types import ImageArray

TRUTH_COLUMNS = (
    *("frame", "lat", "lon", "center_lat", "center_lon", "unix_time_s", "agl_m"),
    *("tl_lat", "tl_lon", "tr_lat", "tr_lon", "bl_lat", "bl_lon", "br_lat", "br_lon"),
)

_MARGIN_M = 60.0
_MOST_PIXELS = 60_000_000


def render_flight(
    out: Path,
    config: FlightConfig,
    *,
    overwrite: bool = False,
    on_frame: Callable[[int], None] | None = None,
) -> RenderedFlight:
    """Render a flight into a folder of its own, which appears when everything is in it.

    ``on_frame`` is told how many frames are done.

    Raises:
        SyntheticFlightError: the flight is too large to render, or its CRS does not fit.
        OutputError: the folder exists already and ``overwrite`` is false, is not a rendered
            flight, or cannot be written.
    """
    with staged_flight(out, overwrite=overwrite) as staging:
        _render_into(staging, config, on_frame)
    return flight_in(out)


def frame_image(
    temperature: ImageArray, ground: Ground, exposure: Exposure, size_px: tuple[int, int]
) -> ImageArray:
    """Return the temperatures ``(h, w)`` that a frame of ``size_px`` (width, height) sees."""
    H_frame_grid = ground.homography_ground_grid() @ exposure.H_frame_ground
    return np.asarray(
        cv2.warpPerspective(
            temperature,
            H_frame_grid,
            size_px,
            flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        dtype=np.float32,
    )


def ground_of(config: FlightConfig, exposures: list[Exposure]) -> Ground:
    """Return the ground to render: all footprints, the drift and a margin around them.

    Its pixels divide the map's, and are as fine as the frames' where memory allows.

    Raises:
        SyntheticFlightError: that is more ground than can be rendered.
    """
    corners = image_corners_px(config.frame_width_px, config.frame_height_px)
    seen_m = np.concatenate([transform_points(e.H_frame_ground, corners) for e in exposures])
    margin_m = _MARGIN_M + config.drift_m
    west, south = seen_m.min(axis=0) - margin_m
    east, north = seen_m.max(axis=0) + margin_m
    finer = max(1, math.floor(config.map_gsd_m / config.frame_gsd_m))
    gsd_m = config.map_gsd_m / finer
    width, height = math.ceil((east - west) / gsd_m), math.ceil((north - south) / gsd_m)
    if width * height > _MOST_PIXELS:
        raise SyntheticFlightError(
            f"the flight covers {(east - west) / 1000:.1f} × {(north - south) / 1000:.1f} km, too"
            f" much to render at {gsd_m:.2f} m/px: take fewer frames, more overlap or a coarser map"
        )
    place = LocalFrame(config.lat_deg, config.lon_deg)
    return Ground(place, float(west), float(north), gsd_m, width, height)


def _render_into(
    flight: RenderedFlight, config: FlightConfig, on_frame: Callable[[int], None] | None
) -> None:
    """Write all four parts of a flight."""
    trajectory, exposures = plan_exposures(config)
    ground = ground_of(config, exposures)
    place = render_landscape(
        config.seed, (ground.width_px, ground.height_px), ground.gsd_m, kind=config.kind
    )
    write_map(
        flight.map,
        place.rgb,
        ground,
        crs=config.crs,
        gsd_m=config.map_gsd_m,
        jpeg=config.jpeg_map,
    )
    # A frame pixel wider than the field's takes the mean of what it covers.
    wider = config.frame_gsd_m / ground.gsd_m
    temperature = smooth(place.temperature, 0.5 * math.sqrt(max(0.0, wider**2 - 1.0)))
    size_px = (config.frame_width_px, config.frame_height_px)
    for index, exposure in enumerate(exposures):
        seen = frame_image(temperature, ground, exposure, size_px)
        frame = render_sensor(seen, random_stream(config, Stream.CAMERA, index), config.sensor)
        _write_png(flight.frames / exposure.name, frame)
        if on_frame is not None:
            on_frame(index + 1)
    _write_truth(flight.truth, config, ground.frame, exposures)
    _write_log(flight.log, config, ground.frame, trajectory, exposures)


def _write_truth(
    path: Path, config: FlightConfig, place: LocalFrame, exposures: list[Exposure]
) -> None:
    """Write the true camera position, ground point at the centre, and corners of every frame."""
    camera = camera_of(config)
    centre = np.array([[camera.principal_x_px, camera.principal_y_px]])
    points_px = np.concatenate([centre, image_corners_px(camera.width_px, camera.height_px)])
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(TRUTH_COLUMNS)
    for exposure in exposures:
        pose = exposure.pose
        below = np.array([[pose.east_m, pose.north_m]])
        seen = transform_points(exposure.H_frame_ground, points_px)
        degrees = place.to_degrees(np.concatenate([below, seen]))
        cells = [f"{value:.8f}" for value in degrees.ravel()]
        middle = [f"{exposure.time_utc_s:.3f}", f"{pose.height_m:.2f}"]
        rows.writerow([exposure.name, *cells[:4], *middle, *cells[4:]])
    path.write_text(text.getvalue(), encoding="utf-8")


def _write_log(
    path: Path,
    config: FlightConfig,
    place: LocalFrame,
    trajectory: Trajectory,
    exposures: list[Exposure],
) -> None:
    """Write what the vehicle believed it did."""
    error = navigation_error(
        random_stream(config, Stream.GPS),
        len(trajectory.times_s),
        drift_m=config.drift_m,
        yaw_bias_rad=math.radians(config.yaw_bias_deg),
        height_bias=config.height_bias,
    )
    book = LogBook(random_stream(config, Stream.LOG), place, trajectory, error, config.start_utc_s)
    times_s = np.array([exposure.time_utc_s - config.start_utc_s for exposure in exposures])
    book.write(path, times_s if config.camera_messages else times_s[:0])


def _write_png(path: Path, frame: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write one frame, 8 or 16 bits."""
    _, encoded = cv2.imencode(".png", frame)
    path.write_bytes(encoded.tobytes())
