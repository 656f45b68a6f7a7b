"""A small rendered flight: same bytes twice, truth that agrees with poses, pixels and log."""

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio

from uasthn_cli.errors import OutputError, SyntheticFlightError
from uasthn_cli.geometry.camera import homography_frame_ground
from uasthn_cli.geometry.corners import (
    homography_from_corners,
    image_corners_px,
    transform_points,
)
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m, from_crs, to_crs
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.synth.exposures import camera_of, plan_exposures
from uasthn_cli.synth.flight import ground_of, render_flight
from uasthn_cli.synth.flight_config import FlightConfig, SensorConfig
from uasthn_cli.synth.flight_folder import RenderedFlight
from uasthn_cli.synth.kinds import Gain, LandscapeKind, Route
from uasthn_cli.synth.landscape import Landscape, render_landscape
from uasthn_cli.types import FloatArray

CONFIG = FlightConfig(
    seed=7,
    kind=LandscapeKind.FARMS,
    frames=6,
    frame_width_px=160,
    frame_height_px=120,
    height_m=120.0,
    map_gsd_m=1.0,
    drift_m=25.0,
    camera_messages=True,
)
CORNERS = ("tl", "tr", "bl", "br")
Rows = list[dict[str, str]]


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> RenderedFlight:
    return render_flight(tmp_path_factory.mktemp("rendered") / "flight", CONFIG)


@pytest.fixture(scope="module")
def truth(flight: RenderedFlight) -> Rows:
    with flight.truth.open(newline="") as handle:
        return list(csv.DictReader(handle))


@pytest.fixture(scope="module")
def place() -> Landscape:
    _, exposures = plan_exposures(CONFIG)
    ground = ground_of(CONFIG, exposures)
    size_px = (ground.width_px, ground.height_px)
    return render_landscape(CONFIG.seed, size_px, ground.gsd_m, kind=CONFIG.kind)


def corners_deg(row: dict[str, str]) -> FloatArray:
    return np.array([[float(row[f"{c}_lat"]), float(row[f"{c}_lon"])] for c in CORNERS])


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_same_config_same_bytes(flight: RenderedFlight, tmp_path: Path) -> None:
    again = render_flight(tmp_path / "again", CONFIG)
    assert files_of(again.map.parent) == files_of(flight.map.parent)


def test_truth_has_a_row_per_frame_in_order(flight: RenderedFlight, truth: Rows) -> None:
    names = sorted(path.name for path in flight.frames.iterdir())
    assert [row["frame"] for row in truth] == names
    assert len(names) == CONFIG.frames
    for row in truth:
        assert row["frame"] == f"frame_{round(1000 * float(row['unix_time_s']))}.png"


def test_convention_true_corners_are_the_true_pose_projected(truth: Rows) -> None:
    trajectory, _ = plan_exposures(CONFIG)
    home = LocalFrame(CONFIG.lat_deg, CONFIG.lon_deg)
    for row in truth:
        pose = trajectory.at(float(row["unix_time_s"]) - CONFIG.start_utc_s)
        H = homography_frame_ground(camera_of(CONFIG), pose.attitude, pose.height_m)
        ground_m = transform_points(H, image_corners_px(160, 120))
        expected = home.to_degrees(ground_m + np.array([pose.east_m, pose.north_m]))
        assert distance_m(corners_deg(row), expected).max() < 0.01
        camera = np.array([float(row["lat"]), float(row["lon"])])
        below = home.to_degrees(np.array([pose.east_m, pose.north_m]))
        assert distance_m(camera, below) < 0.01
        assert float(row["agl_m"]) == pytest.approx(pose.height_m, abs=0.01)


def test_frames_show_the_ground_that_truth_says(
    flight: RenderedFlight, truth: Rows, place: Landscape
) -> None:
    _, exposures = plan_exposures(CONFIG)
    ground = ground_of(CONFIG, exposures)
    likeness = []
    for row in truth:
        frame = cv2.imread(str(flight.frames / row["frame"]), cv2.IMREAD_UNCHANGED)
        assert frame is not None
        assert frame.shape == (120, 160)
        grid_px = transform_points(
            ground.homography_ground_grid(), ground.frame.to_metres(corners_deg(row))
        )
        H = homography_from_corners(image_corners_px(160, 120), grid_px)
        seen = cv2.warpPerspective(
            place.temperature, H, (160, 120), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        # Gain control bends the scale: compare ranks.
        ranks = [np.argsort(np.argsort(image, axis=None)) for image in (frame, seen)]
        likeness.append(np.corrcoef(ranks[0], ranks[1])[0, 1])
    assert min(likeness) > 0.9


def test_map_shows_the_landscape_in_its_place(flight: RenderedFlight, place: Landscape) -> None:
    _, exposures = plan_exposures(CONFIG)
    ground = ground_of(CONFIG, exposures)
    with rasterio.open(flight.map) as raster:
        assert raster.count == 3
        assert raster.crs.to_epsg() == 32614
        assert raster.profile["tiled"]
        assert raster.overviews(1)
        assert raster.compression.name == "deflate"
        bands = raster.read()
        columns, rows = np.meshgrid(np.arange(5, raster.width - 5), np.arange(5, raster.height - 5))
        grid = raster.transform
        xs = grid.c + grid.a * (columns + 0.5)
        ys = grid.f + grid.e * (rows + 0.5)
    degrees = ground.frame.to_degrees(ground.edge_m(2))
    x_edges = to_crs("EPSG:32614", degrees)[..., 0]
    assert x_edges.min() - 1.0 < xs.min() < xs.max() < x_edges.max() + 1.0
    assert bands.max(axis=0).all(), "no empty pixel"
    grid_px = transform_points(
        ground.homography_ground_grid(),
        ground.frame.to_metres(from_crs("EPSG:32614", np.stack([xs, ys], -1).reshape(-1, 2))),
    ).reshape(*xs.shape, 2)
    expected = cv2.remap(
        place.rgb[..., 1].astype(np.float32),
        grid_px[..., 0].astype(np.float32),
        grid_px[..., 1].astype(np.float32),
        cv2.INTER_LINEAR,
    )
    shown = bands[1, 5:-5, 5:-5].astype(np.float32)
    assert np.corrcoef(shown.ravel(), expected.ravel())[0, 1] > 0.97


def test_log_reads_back_and_errs_as_asked(flight: RenderedFlight, truth: Rows) -> None:
    telemetry = read_telemetry(flight.log)
    times_s = np.array([float(row["unix_time_s"]) for row in truth])
    clock_s = float(np.median(telemetry.system_times.unix_s - telemetry.system_times.stamps.boot_s))
    logged_s = telemetry.positions.stamps.boot_s + clock_s
    logged = np.stack(
        [
            np.interp(times_s, logged_s, telemetry.positions.lat_deg),
            np.interp(times_s, logged_s, telemetry.positions.lon_deg),
        ],
        axis=-1,
    )
    true = np.array([[float(row["lat"]), float(row["lon"])] for row in truth])
    error_m = distance_m(logged, true)
    assert 1.0 < error_m.max() < 26.0
    assert logged_s[0] < times_s[0]
    assert logged_s[-1] > times_s[-1]
    latency_s = telemetry.positions.stamps.record_s - logged_s
    assert 0.0 < latency_s.min() <= latency_s.max() < 0.05
    assert [len(events.file_names) for events in telemetry.camera_events] == [len(truth)]
    assert telemetry.camera_events[0].unix_s == pytest.approx(times_s, abs=1e-3)


def test_radiometric_frames_of_a_free_track_in_degrees(tmp_path: Path) -> None:
    config = replace(
        CONFIG,
        frames=2,
        route=Route.TRACK,
        map_crs="EPSG:4326",
        jpeg_map=True,
        sensor=SensorConfig(gain=Gain.RADIOMETRIC),
    )
    flight = render_flight(tmp_path / "flight", config)
    frame = cv2.imread(str(next(flight.frames.iterdir())), cv2.IMREAD_UNCHANGED)
    assert frame is not None
    assert frame.dtype == np.uint16
    with rasterio.open(flight.map) as raster:
        assert raster.crs.to_epsg() == 4326
        assert raster.compression.name == "jpeg"
        assert raster.read().max(axis=0).all()


def test_an_existing_folder_is_replaced_only_on_request(tmp_path: Path) -> None:
    config = replace(CONFIG, frames=1)
    out = tmp_path / "flight"
    render_flight(out, config)
    before = files_of(out)
    with pytest.raises(OutputError, match="exists already"):
        render_flight(out, config)
    assert files_of(out) == before
    render_flight(out, replace(config, seed=8), overwrite=True)
    assert files_of(out) != before
    assert [path.name for path in tmp_path.iterdir()] == ["flight"]


def test_a_folder_that_is_no_flight_is_never_replaced(tmp_path: Path) -> None:
    keepsake = tmp_path / "notes.txt"
    keepsake.write_text("keep me")
    with pytest.raises(OutputError, match="not a rendered flight"):
        render_flight(tmp_path, CONFIG, overwrite=True)
    assert keepsake.read_text() == "keep me"


def test_a_failure_leaves_nothing_behind(tmp_path: Path) -> None:
    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_flight(tmp_path / "flight", CONFIG, on_frame=interrupt)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "change",
    [
        {"frames": 0},
        {"hfov_deg": 170.0},
        {"overlap": 1.0},
        {"wind_m_s": 17.0},
        {"lat_deg": 89.0},
        {"map_gsd_m": 0.0},
    ],
)
def test_impossible_flights_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(SyntheticFlightError):
        replace(CONFIG, **change)  # type: ignore[arg-type]  # ranges are what is tested


def test_flights_too_large_to_render_are_refused(tmp_path: Path) -> None:
    config = replace(CONFIG, frames=500, height_m=1500.0, map_gsd_m=0.5, overlap=0.0)
    with pytest.raises(SyntheticFlightError, match="coarser map"):
        render_flight(tmp_path / "flight", config)


def test_a_crs_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SyntheticFlightError, match="EPSG:999999"):
        render_flight(tmp_path / "flight", replace(CONFIG, frames=1, map_crs="EPSG:999999"))
    assert list(tmp_path.iterdir()) == []
