"""Which height over ground is taken, and that nonsense is not."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simple_flight_log import (
    LAT_DEG,
    LON_DEG,
    START_UTC_S,
    TAKE_OFF_AMSL_M,
    FlightPlan,
    write_flight,
)

from uasthn_cli.config import PriorConfig
from uasthn_cli.ingest.height import start_of
from uasthn_cli.ingest.mavlink import TlogWriter, read_telemetry
from uasthn_cli.ingest.priors import PriorSet, build_priors
from uasthn_cli.types import FrameFailure, FrameFile, Prior, Reason

FRAME = FrameFile("x.png", Path("x.png"))


def priors_with(
    folder: Path, *messages: tuple[str, dict[str, object]], height_m: float = 120.0
) -> PriorSet:
    """Return the prior of one frame 10 s into a flight that also logs these messages at 2 Hz."""
    path = folder / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log, FlightPlan(height_m=height_m))
        for index in range(60):
            for name, fields in messages:
                stamp = {"time_boot_ms": 40_000 + 500 * index} if name == "DISTANCE_SENSOR" else {}
                log.write(START_UTC_S + 0.5 * index, name, **fields, **stamp)
    frame = FrameFile(f"{round((START_UTC_S + 10.0) * 1000)}.png", FRAME.path)
    return build_priors(read_telemetry(path), [frame], config=PriorConfig())


def distance_sensor(
    distance_cm: int, orientation: int = 25, max_cm: int = 30_000
) -> tuple[str, dict[str, object]]:
    limits = {"min_distance": 20, "max_distance": max_cm, "current_distance": distance_cm}
    return "DISTANCE_SENSOR", {
        **limits,
        "type": 0,
        "id": 1,
        "orientation": orientation,
        "covariance": 0,
    }


def terrain_report(height_m: float, spacing: int = 100) -> tuple[str, dict[str, object]]:
    counts = {"lat": 0, "lon": 0, "spacing": spacing, "pending": 0, "loaded": 336}
    return "TERRAIN_REPORT", {**counts, "terrain_height": 400.0, "current_height": height_m}


def rangefinder(distance_m: float) -> tuple[str, dict[str, object]]:
    return "RANGEFINDER", {"distance": distance_m, "voltage": 0.0}


@pytest.mark.parametrize(
    ("messages", "expected_m", "source"),
    [
        ((), 120.0, "relative_alt"),
        ((terrain_report(101.0),), 101.0, "terrain_report"),
        ((terrain_report(101.0), rangefinder(110.0)), 110.0, "rangefinder"),
        ((terrain_report(101.0), distance_sensor(11_500)), 115.0, "distance_sensor"),
        ((rangefinder(110.0), distance_sensor(11_500)), 115.0, "distance_sensor"),
    ],
)
def test_measured_heights_come_first(
    tmp_path: Path,
    messages: tuple[tuple[str, dict[str, object]], ...],
    expected_m: float,
    source: str,
) -> None:
    found = priors_with(tmp_path, *messages)
    (prior,) = found.results
    assert isinstance(prior, Prior)
    assert prior.height_source == found.height_source == source
    # the vehicle is tilted by some degrees, which shortens what a fixed sensor measures
    assert prior.height_above_ground_m == pytest.approx(expected_m, rel=0.005)


def test_a_slant_range_is_made_vertical(tmp_path: Path) -> None:
    (prior,) = priors_with(tmp_path, rangefinder(110.0)).results
    assert isinstance(prior, Prior)
    tilt = math.cos(prior.attitude.roll_rad) * math.cos(prior.attitude.pitch_rad)
    assert prior.height_above_ground_m == pytest.approx(110.0 * tilt)


@pytest.mark.parametrize(
    "message",
    [
        distance_sensor(30_000),
        distance_sensor(11_500, orientation=0),
        distance_sensor(700, max_cm=4000),
        terrain_report(-92.0),
        terrain_report(101.0, spacing=0),
        terrain_report(1000.0),
        rangefinder(0.0),
        rangefinder(3.1),
        rangefinder(float("nan")),
    ],
)
def test_out_of_range_and_forward_sensors_are_not_believed(
    tmp_path: Path, message: tuple[str, dict[str, object]]
) -> None:
    assert priors_with(tmp_path, message).height_source == "relative_alt"


def test_a_frame_on_the_ground_has_no_prior(tmp_path: Path) -> None:
    (failure,) = priors_with(tmp_path, height_m=0.4).results
    assert isinstance(failure, FrameFailure)
    assert failure.reason is Reason.NO_PRIOR
    assert "0.4 m" in failure.detail


def test_a_given_height_replaces_all_others(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log)
    telemetry = read_telemetry(path)
    frame = FrameFile(f"{round((START_UTC_S + 10.0) * 1000)}.png", FRAME.path)
    config = replace(PriorConfig(), height_above_ground_m=77.0)
    found = build_priors(telemetry, [frame], config=config)
    (prior,) = found.results
    assert isinstance(prior, Prior)
    assert (prior.height_above_ground_m, found.height_source) == (77.0, "given")
    assert np.isfinite(prior.lat_deg)


@pytest.mark.parametrize(("height_m", "is_on_ground"), [(1.5, True), (120.0, False)])
def test_take_off_is_known_where_the_log_starts_there(
    tmp_path: Path, height_m: float, is_on_ground: bool
) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log, FlightPlan(height_m=height_m))
    start = start_of(read_telemetry(path))
    assert start.is_on_ground is is_on_ground
    assert (start.lat_deg, start.lon_deg) == pytest.approx((LAT_DEG, LON_DEG), abs=1e-6)
    assert start.ground_amsl_m == pytest.approx(TAKE_OFF_AMSL_M)
    assert not start.is_assumed
