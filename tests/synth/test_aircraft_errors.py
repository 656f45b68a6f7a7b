"""Rendered flights with the errors of real aircraft: what the log, the names and the truth say."""

import csv
import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m, to_crs
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.ingest.telemetry import Telemetry
from uasthn_cli.synth.aircraft_errors import AircraftErrors
from uasthn_cli.synth.exposures import mounted, plan_exposures
from uasthn_cli.synth.flight import render_flight
from uasthn_cli.synth.flight_config import FlightConfig, StressConfig
from uasthn_cli.synth.flight_folder import RenderedFlight
from uasthn_cli.synth.flight_truth import POSE_COLUMNS, TRUTH_COLUMNS
from uasthn_cli.synth.kinds import LandscapeKind, StressCategory
from uasthn_cli.synth.losses import frames_kept, messages_kept
from uasthn_cli.synth.stress import render_stressed_flight
from uasthn_cli.synth.trajectory import attitude_drift
from uasthn_cli.types import FloatArray

CONFIG = FlightConfig(
    seed=7,
    kind=LandscapeKind.FARMS,
    frames=8,
    frame_width_px=96,
    frame_height_px=80,
    height_m=120.0,
    drift_m=20.0,
    height_bias=0.0,
    camera_messages=True,
)
ERRORS = AircraftErrors(
    mount_roll_deg=1.0,
    mount_pitch_deg=-2.0,
    attitude_drift_deg=1.5,
    relief_m=30.0,
    lens_k1=-0.12,
    clock_late_s=0.4,
)
Rows = list[dict[str, str]]


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> RenderedFlight:
    out = tmp_path_factory.mktemp("errors") / "flight"
    return render_flight(out, replace(CONFIG, errors=ERRORS))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> RenderedFlight:
    return render_flight(tmp_path_factory.mktemp("plain") / "flight", CONFIG)


def rows_of(flight: RenderedFlight) -> Rows:
    with flight.truth.open(newline="") as handle:
        return list(csv.DictReader(handle))


def column(rows: Rows, name: str) -> FloatArray:
    return np.array([float(row[name]) for row in rows])


def logged(telemetry: Telemetry, times_s: FloatArray, name: str) -> FloatArray:
    clock_s = float(np.median(telemetry.system_times.unix_s - telemetry.system_times.stamps.boot_s))
    stamps_s = telemetry.attitudes.stamps.boot_s + clock_s
    return np.asarray(np.interp(times_s, stamps_s, getattr(telemetry.attitudes, name)))


def test_without_errors_nothing_is_added(plain: RenderedFlight) -> None:
    assert plain.dem is None
    assert {path.name for path in plain.map.parent.iterdir()} == {
        "map.tif",
        "frames",
        "flight.tlog",
        "truth.csv",
    }
    assert tuple(rows_of(plain)[0]) == TRUTH_COLUMNS


def test_truth_is_on_the_surface_of_the_dem(flight: RenderedFlight) -> None:
    rows = rows_of(flight)
    assert tuple(rows[0]) == TRUTH_COLUMNS + POSE_COLUMNS
    assert flight.dem is not None
    with rasterio.open(flight.dem) as dem, rasterio.open(flight.map) as shown:
        assert dem.crs == shown.crs
        assert dem.bounds.left < shown.bounds.left
        assert dem.bounds.right > shown.bounds.right
        camera = np.stack([column(rows, "lat"), column(rows, "lon")], axis=-1)
        ground_m = np.array([v[0] for v in dem.sample(to_crs(dem.crs.to_wkt(), camera))])
    over_ground_m = column(rows, "alt_amsl_m") - ground_m
    assert np.ptp(ground_m) > 1.0
    assert column(rows, "agl_m") == pytest.approx(over_ground_m, abs=2.0)  # nearest of 10 m


def test_truth_has_the_angles_of_the_camera_and_the_log_those_of_the_vehicle(
    flight: RenderedFlight,
) -> None:
    rows = rows_of(flight)
    times_s = column(rows, "unix_time_s")
    trajectory, _ = plan_exposures(replace(CONFIG, errors=ERRORS))
    telemetry = read_telemetry(flight.log)
    strayed_deg = []
    for row, time_s in zip(rows, times_s, strict=True):
        vehicle = trajectory.at(time_s - CONFIG.start_utc_s).attitude
        camera = mounted(vehicle, ERRORS)
        for name in ("roll", "pitch", "yaw"):
            angle_deg = math.degrees(getattr(camera, f"{name}_rad"))
            off_deg = math.remainder(float(row[f"{name}_deg"]) - angle_deg, 360.0)
            assert abs(off_deg) < 1e-3
        assert float(row["pitch_deg"]) - math.degrees(vehicle.pitch_rad) == pytest.approx(
            -2.0, abs=0.1
        )
        pitch_rad = logged(telemetry, np.array([time_s]), "pitch_rad")[0]
        strayed_deg.append(math.degrees(pitch_rad - vehicle.pitch_rad))
    assert 0.2 < np.abs(strayed_deg).max() < 1.5 + 0.6
    assert all(0.0 <= float(row["yaw_deg"]) < 360.0 for row in rows)


def test_altitudes_of_the_log_fit_the_dem(flight: RenderedFlight) -> None:
    rows = rows_of(flight)
    telemetry = read_telemetry(flight.log)
    positions = telemetry.positions
    assert flight.dem is not None
    start = np.array([[positions.lat_deg[0], positions.lon_deg[0]]])
    with rasterio.open(flight.dem) as dem:
        ((take_off_m,),) = dem.sample(to_crs(dem.crs.to_wkt(), start))
    clock_s = float(np.median(telemetry.system_times.unix_s - telemetry.system_times.stamps.boot_s))
    relative_m = np.interp(
        column(rows, "unix_time_s"), positions.stamps.boot_s + clock_s, positions.height_m
    )
    assert take_off_m != pytest.approx(410.0, abs=0.5)
    assert relative_m + take_off_m == pytest.approx(column(rows, "alt_amsl_m"), abs=2.0)


def test_a_late_clock_names_frames_too_early_and_changes_nothing_else(
    plain: RenderedFlight, tmp_path: Path
) -> None:
    errors = AircraftErrors(clock_late_s=2.5)
    late = render_flight(tmp_path / "flight", replace(CONFIG, errors=errors))
    rows, before = rows_of(late), rows_of(plain)
    for row, same in zip(rows, before, strict=True):
        stamped_s = int(row["frame"].removeprefix("frame_").removesuffix(".png")) / 1000
        assert stamped_s + 2.5 == pytest.approx(float(row["unix_time_s"]), abs=1e-3)
        assert row["unix_time_s"] == same["unix_time_s"]
        image = (late.frames / row["frame"]).read_bytes()
        assert image == (plain.frames / same["frame"]).read_bytes()
    for part in ("map", "log"):
        assert getattr(late, part).read_bytes() == getattr(plain, part).read_bytes()


def test_lost_frames_leave_the_others_as_they_were(plain: RenderedFlight, tmp_path: Path) -> None:
    errors = AircraftErrors(lose_frames=0.4, lose_messages=0.25, renumber=True)
    done: list[int] = []
    lossy = render_flight(tmp_path / "f", replace(CONFIG, errors=errors), on_frame=done.append)
    rows, before = rows_of(lossy), {row["unix_time_s"]: row for row in rows_of(plain)}
    assert [row["frame"] for row in rows] == [f"frame_{n:04d}.png" for n in range(1, 6)]
    assert sorted(path.name for path in lossy.frames.iterdir()) == [row["frame"] for row in rows]
    assert len(done) == 5
    for row in rows:
        same = before[row["unix_time_s"]]
        assert row["center_lat"] == same["center_lat"]
        image = (lossy.frames / row["frame"]).read_bytes()
        assert image == (plain.frames / same["frame"]).read_bytes()
    (events,) = read_telemetry(lossy.log).camera_events
    (every,) = read_telemetry(plain.log).camera_events
    assert len(events.unix_s) == 6
    assert set(events.unix_s) < set(every.unix_s)


@given(share=st.floats(0.0, 0.9), frames=st.integers(1, 40), seed=st.integers(0, 50))
def test_as_many_are_lost_as_asked_and_one_remains(share: float, frames: int, seed: int) -> None:
    errors = AircraftErrors(lose_frames=share, lose_messages=share)
    config = replace(CONFIG, seed=seed, errors=errors)
    exposures = plan_exposures(CONFIG)[1] * 5
    kept = frames_kept(config, exposures[:frames])
    assert len(kept) == max(1, frames - round(share * frames))
    numbers = [number for number, _ in kept]
    assert numbers == sorted(set(numbers))
    assert [exposure for _, exposure in kept] == [exposures[number] for number in numbers]
    messages = messages_kept(config, frames)
    assert len(messages) == len(kept)
    assert messages == sorted(set(messages))


@given(largest_deg=st.floats(0.0, 20.0), seed=st.integers(0, 100))
def test_attitude_drifts_to_its_limit_and_no_farther(largest_deg: float, seed: int) -> None:
    drift = attitude_drift(np.random.default_rng(seed), 3000, math.radians(largest_deg))
    farthest = np.degrees(np.abs(drift).max(axis=1))
    assert drift.shape == (3, 3000)
    assert farthest == pytest.approx([largest_deg] * 3, rel=1e-6)


@given(
    name=st.sampled_from([part.name for part in fields(AircraftErrors) if part.name != "renumber"]),
    value=st.sampled_from([math.nan, math.inf, -1e9, 1e9]),
)
def test_values_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(SyntheticFlightError, match="between"):
        replace(AircraftErrors(), **{name: value})  # type: ignore[arg-type]  # what is tested


@pytest.mark.parametrize(
    ("errors", "change", "said"),
    [
        (AircraftErrors(relief_m=100.0), {}, "relief of 100 m under 120 m"),
        (AircraftErrors(lens_k1=-0.4), {"hfov_deg": 90.0}, "no ray arrives"),
        (AircraftErrors(lose_messages=0.1), {"camera_messages": False}, "camera-messages"),
    ],
)
def test_errors_that_do_not_fit_the_flight_are_refused(
    errors: AircraftErrors, change: dict[str, float], said: str
) -> None:
    with pytest.raises(SyntheticFlightError, match=said):
        replace(CONFIG, errors=errors, **change)  # type: ignore[arg-type]  # what is tested


def test_numbered_frames_have_no_clock() -> None:
    with pytest.raises(SyntheticFlightError, match="carry no time"):
        AircraftErrors(renumber=True, clock_late_s=1.0)


def test_stress_keeps_the_dem_and_refuses_what_needs_a_plane(tmp_path: Path) -> None:
    config = replace(CONFIG, frames=2, errors=AircraftErrors(relief_m=20.0))
    faded = render_stressed_flight(
        tmp_path / "faded", config, StressConfig(StressCategory.TEXTURELESS, 0.5)
    )
    assert faded.dem is not None
    for category in (StressCategory.GEOMETRY, StressCategory.SELF_SIMILAR):
        with pytest.raises(SyntheticFlightError, match="flat ground"):
            render_stressed_flight(tmp_path / "bent", config, StressConfig(category))
    assert [path.name for path in tmp_path.iterdir()] == ["faded"]


def test_the_first_camera_lies_where_the_vehicle_was(flight: RenderedFlight) -> None:
    trajectory, exposures = plan_exposures(replace(CONFIG, errors=ERRORS))
    home = LocalFrame(CONFIG.lat_deg, CONFIG.lon_deg)
    rows = rows_of(flight)
    camera = np.stack([column(rows, "lat"), column(rows, "lon")], axis=-1)
    poses = [trajectory.at(e.time_utc_s - CONFIG.start_utc_s) for e in exposures]
    below = home.to_degrees(np.array([(pose.east_m, pose.north_m) for pose in poses]))
    assert distance_m(camera, below).max() < 0.01
