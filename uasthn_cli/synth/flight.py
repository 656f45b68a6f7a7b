"""Render a flight with known truth: ``map.tif``, ``frames/``, ``flight.tlog``, ``truth.csv``.

With relief, also ``dem.tif``.
"""

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.synth.aircraft_errors import AircraftErrors
from uasthn_cli.synth.exposures import (
    Exposure,
    Stream,
    camera_of,
    plan_exposures,
    random_stream,
)
from uasthn_cli.synth.flight_config import FlightConfig
from uasthn_cli.synth.flight_folder import RenderedFlight, dem_in, flight_in, staged_flight
from uasthn_cli.synth.flight_log import LogBook
from uasthn_cli.synth.flight_truth import write_truth
from uasthn_cli.synth.landscape import render_landscape
from uasthn_cli.synth.losses import frames_kept, messages_kept
from uasthn_cli.synth.map_raster import Ground, write_map
from uasthn_cli.synth.noise import smooth
from uasthn_cli.synth.relief import Relief, draw_relief, write_dem
from uasthn_cli.synth.sensor import render_sensor
from uasthn_cli.synth.sight import Sight
from uasthn_cli.synth.trajectory import Trajectory, attitude_drift, navigation_error
from uasthn_cli.types import FloatArray, ImageArray

_MARGIN_M = 60.0
_MOST_PIXELS = 60_000_000
_EDGE_STEPS = 17


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
    temperature: ImageArray,
    ground: Ground,
    exposure: Exposure,
    size_px: tuple[int, int],
    sight: Sight,
) -> ImageArray:
    """Return the temperatures ``(h, w)`` that a frame of ``size_px`` (width, height) sees."""
    H_ground_grid = ground.homography_ground_grid()
    if not sight.is_homography:
        seen_m = sight.frame_seen_m(exposure)
        grid_px = transform_points(H_ground_grid, seen_m.reshape(-1, 2)).reshape(seen_m.shape)
        columns, rows = np.moveaxis(grid_px.astype(np.float32), -1, 0)
        return np.asarray(
            cv2.remap(temperature, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE),
            dtype=np.float32,
        )
    H_frame_grid = H_ground_grid @ exposure.H_frame_ground
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
    seen_m = _reach_m(config, exposures)
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


def _reach_m(config: FlightConfig, exposures: list[Exposure]) -> FloatArray:
    """Return points ``(n, 2)`` in local metres around all that frames see, or could with relief."""
    sight = Sight(camera_of(config), None)
    corners = image_corners_px(config.frame_width_px, config.frame_height_px)
    outline = corners
    if not sight.is_homography:  # a lens bends the edges: corners alone do not bound them
        steps = np.linspace(0.0, 1.0, _EDGE_STEPS)[:, None]
        sides = ((0, 1), (1, 3), (3, 2), (2, 0))
        outline = np.concatenate([corners[a] + steps * (corners[b] - corners[a]) for a, b in sides])
    flat_m = [sight.seen_m(exposure, outline) for exposure in exposures]
    if not config.errors.relief_m:
        return np.concatenate(flat_m)
    reach_m = []
    for exposure, seen_m in zip(exposures, flat_m, strict=True):
        below_m = np.array([exposure.pose.east_m, exposure.pose.north_m])
        deeper = config.errors.relief_m / exposure.pose.height_m
        reach_m += [below_m + (seen_m - below_m) * (1.0 + side * deeper) for side in (-1.0, 1.0)]
    return np.concatenate(reach_m)


def _relief_of(config: FlightConfig, ground: Ground) -> Relief | None:
    """Return the relief of a flight's ground; None where it is flat."""
    if not config.errors.relief_m:
        return None
    return draw_relief(random_stream(config, Stream.RELIEF), ground, config.errors.relief_m)


def _render_into(
    flight: RenderedFlight, config: FlightConfig, on_frame: Callable[[int], None] | None
) -> None:
    """Write all parts of a flight."""
    trajectory, exposures = plan_exposures(config)
    ground = ground_of(config, exposures)
    relief = _relief_of(config, ground)
    kept = frames_kept(config, exposures)
    write_truth(
        flight.truth,
        ground.frame,
        camera_of(config),
        relief,
        [exposure for _, exposure in kept],
        with_pose=config.errors != AircraftErrors(),
    )
    if relief is not None:
        write_dem(dem_in(flight.map.parent), relief, ground, config.utm_crs)
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
    _write_frames(
        flight.frames,
        config,
        ground,
        place.temperature,
        Sight(camera_of(config), relief),
        kept,
        on_frame,
    )
    _write_log(flight.log, config, ground.frame, trajectory, exposures, relief)


def _write_frames(
    folder: Path,
    config: FlightConfig,
    ground: Ground,
    sharp_k: ImageArray,
    sight: Sight,
    kept: list[tuple[int, Exposure]],
    on_frame: Callable[[int], None] | None,
) -> None:
    """Write the frames that exist; a lost one counts as done."""
    # A frame pixel wider than the field's takes the mean of what it covers.
    wider = config.frame_gsd_m / ground.gsd_m
    temperature = smooth(sharp_k, 0.5 * math.sqrt(max(0.0, wider**2 - 1.0)))
    size_px = (config.frame_width_px, config.frame_height_px)
    for index, exposure in kept:
        seen = frame_image(temperature, ground, exposure, size_px, sight)
        frame = render_sensor(seen, random_stream(config, Stream.CAMERA, index), config.sensor)
        _write_png(folder / exposure.name, frame)
        if on_frame is not None:
            on_frame(index + 1)


def _write_log(
    path: Path,
    config: FlightConfig,
    place: LocalFrame,
    trajectory: Trajectory,
    exposures: list[Exposure],
    relief: Relief | None,
) -> None:
    """Write what the vehicle believed it did; it took off where its log begins."""
    count = len(trajectory.times_s)
    error = navigation_error(
        random_stream(config, Stream.GPS),
        count,
        drift_m=config.drift_m,
        yaw_bias_rad=math.radians(config.yaw_bias_deg),
        height_bias=config.height_bias,
        attitude_rad=attitude_drift(
            random_stream(config, Stream.ATTITUDE),
            count,
            math.radians(config.errors.attitude_drift_deg),
        ),
    )
    start_m = np.array(
        [trajectory.east_m[0] + error.east_m[0], trajectory.north_m[0] + error.north_m[0]]
    )
    book = LogBook(
        random_stream(config, Stream.LOG),
        place,
        trajectory,
        error,
        config.start_utc_s,
        0.0 if relief is None else float(relief.at(start_m[None])[0]),
    )
    times_s = [exposure.time_utc_s - config.start_utc_s for exposure in exposures]
    book.write(path, [(number, times_s[number]) for number in messages_kept(config, len(times_s))])


def _write_png(path: Path, frame: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write one frame, 8 or 16 bits."""
    _, encoded = cv2.imencode(".png", frame)
    path.write_bytes(encoded.tobytes())
