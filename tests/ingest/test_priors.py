"""From log and frames to priors, on flights whose truth is known."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simple_flight_log import (
    START_UTC_S,
    TAKE_OFF_AMSL_M,
    FlightPlan,
    flight_telemetry,
    make_frame_files,
    true_angles_rad,
    true_lat_lon_deg,
)

from uasthn_cli.config import PriorConfig, TimeBase
from uasthn_cli.errors import FrameTimesError
from uasthn_cli.geometry.geodesy import distance_m
from uasthn_cli.ingest.frames import list_frames
from uasthn_cli.ingest.priors import PriorSet, build_priors
from uasthn_cli.types import FrameFailure, Prior, Reason

TIMES_S = [START_UTC_S + s for s in (2.13, 9.57, 17.04, 33.3, 48.91)]


def build(
    folder: Path,
    times_s: list[float],
    plan: FlightPlan | None = None,
    config: PriorConfig | None = None,
) -> PriorSet:
    """Write a log and frames named by these times, and look the frames up."""
    telemetry = flight_telemetry(folder, plan or FlightPlan())
    frames = list_frames(make_frame_files(folder, times_s))
    return build_priors(telemetry, frames, config=config or PriorConfig())


def error_m(prior: Prior, time_utc_s: float) -> float:
    found, true = (prior.lat_deg, prior.lon_deg), true_lat_lon_deg(time_utc_s)
    return float(distance_m(np.array(found), np.array(true)))


def turned_deg(prior: Prior, time_utc_s: float) -> float:
    """Return the largest error of roll, pitch and yaw."""
    found = prior.attitude
    angles = (found.roll_rad, found.pitch_rad, found.yaw_rad)
    return max(
        abs(math.degrees(math.remainder(a - b, 2 * math.pi)))
        for a, b in zip(angles, true_angles_rad(time_utc_s), strict=True)
    )


@pytest.mark.parametrize(
    "plan",
    [
        FlightPlan(),
        FlightPlan(system_time_error_s=None),
        FlightPlan(system_time_error_s=2.8e10, delay_s=0.1),
        FlightPlan(record_error_s=-3 * 86_400.0, delay_s=0.6),
    ],
)
def test_priors_are_where_the_vehicle_was(tmp_path: Path, plan: FlightPlan) -> None:
    found = build(tmp_path, TIMES_S, plan)
    assert [r.frame.name for r in found.results] == [f"frame_{round(t * 1e3)}.png" for t in TIMES_S]
    for prior, time_s in zip(found.results, TIMES_S, strict=True):
        assert isinstance(prior, Prior)
        assert prior.time_utc_s == pytest.approx(time_s, abs=1e-3)
        assert error_m(prior, time_s) < 1.0
        assert turned_deg(prior, time_s) < 2.0
        assert prior.height_above_ground_m == pytest.approx(120.0)
        assert prior.alt_amsl_m == pytest.approx(120.0 + TAKE_OFF_AMSL_M)
    assert found.altitude_source == "GLOBAL_POSITION_INT.alt"


def test_convention_the_offset_is_added_to_the_frame_s_time(tmp_path: Path) -> None:
    """The camera's clock is 2.5 s slow: what it calls 10.0 the log recorded at 12.5."""
    true_s = START_UTC_S + 12.5
    found = build(tmp_path, [true_s - 2.5], config=PriorConfig(time_offset_s=2.5))
    (prior,) = found.results
    assert isinstance(prior, Prior)
    assert prior.time_utc_s == pytest.approx(true_s)
    assert error_m(prior, true_s) < 0.5


def test_the_offset_counts_when_the_clock_is_chosen(tmp_path: Path) -> None:
    """Frames an hour off cover the log by neither clock unless the offset is applied."""
    times_s = [t - 3600.0 for t in TIMES_S]
    plan = FlightPlan(system_time_error_s=3 * 86_400.0)
    found = build(tmp_path, times_s, plan, PriorConfig(time_offset_s=3600.0))
    assert found.time_base.base is TimeBase.RECORD
    assert all(isinstance(result, Prior) for result in found.results)


def test_frames_outside_the_log_or_in_a_hole_become_rows(tmp_path: Path) -> None:
    times_s = [START_UTC_S + s for s in (-4.0, 10.0, 23.0, 31.0, 70.0)]
    found = build(tmp_path, times_s, FlightPlan(gap_s=(20.0, 30.0)))
    kinds = [r.reason if isinstance(r, FrameFailure) else None for r in found.results]
    outside = Reason.OUTSIDE_LOG
    assert kinds == [outside, None, outside, None, outside]
    details = [r.detail for r in found.results if isinstance(r, FrameFailure)]
    for detail, words in zip(
        details, ("4.0 s before", "in a gap of 10.2 s", "10.2 s after"), strict=True
    ):
        assert words in detail


def test_a_longer_gap_may_be_allowed(tmp_path: Path) -> None:
    times_s = [START_UTC_S + 25.0]
    plan, config = FlightPlan(gap_s=(20.0, 30.0)), PriorConfig(max_gap_s=11.0)
    (prior,) = build(tmp_path, times_s, plan, config).results
    assert isinstance(prior, Prior)
    assert error_m(prior, times_s[0]) < 0.5


def test_a_frame_without_time_is_a_row(tmp_path: Path) -> None:
    telemetry = flight_telemetry(tmp_path)
    folder = make_frame_files(tmp_path, TIMES_S)
    (folder / "z_preview.png").touch()
    results = build_priors(telemetry, list_frames(folder), config=PriorConfig()).results
    assert isinstance(results[-1], FrameFailure)
    assert results[-1].reason is Reason.NO_TIME
    assert sum(isinstance(result, Prior) for result in results) == len(TIMES_S)


def test_a_time_that_occurs_in_two_flights_is_not_guessed(tmp_path: Path) -> None:
    first = FlightPlan(system_time_error_s=None)
    second = replace(first, boot_before_start_s=20.0)
    telemetry = flight_telemetry(tmp_path, first, second)
    frames = list_frames(make_frame_files(tmp_path, TIMES_S))
    for result in build_priors(telemetry, frames, config=PriorConfig()).results:
        assert isinstance(result, FrameFailure)
        assert result.reason is Reason.NO_PRIOR
        assert "2 of its flights" in result.detail


def test_the_table_may_date_nameless_frames(tmp_path: Path) -> None:
    telemetry = flight_telemetry(tmp_path)
    folder = tmp_path / "frames"
    folder.mkdir()
    (folder / "a.png").touch()
    frames = list_frames(folder)
    with pytest.raises(FrameTimesError):
        build_priors(telemetry, frames, config=PriorConfig())
    csv = tmp_path / "times.csv"
    csv.write_text(f"frame,time\na.png,{TIMES_S[1]}\n")
    found = build_priors(telemetry, frames, config=PriorConfig(), frame_times_csv=csv)
    (prior,) = found.results
    assert isinstance(prior, Prior)
    assert error_m(prior, TIMES_S[1]) < 0.5
    assert found.frame_times.source == "table"


def test_the_same_input_gives_the_same_priors(tmp_path: Path) -> None:
    telemetry = flight_telemetry(tmp_path)
    frames = list_frames(make_frame_files(tmp_path, TIMES_S))
    first, second = (build_priors(telemetry, frames, config=PriorConfig()) for _ in range(2))
    assert first.results == second.results
