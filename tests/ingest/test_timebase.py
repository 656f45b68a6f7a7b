"""Which clock is believed, and that it is smooth."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simple_flight_log import START_UTC_S, FlightPlan, flight_telemetry

from uasthn_cli.config import TimeBase
from uasthn_cli.errors import FrameTimesError
from uasthn_cli.ingest.clock import Clock, find_sessions
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.ingest.timebase import choose_time_base, covered_share, log_spans_s
from uasthn_cli.types import FloatArray

DAY_S = 86_400.0
FRAMES_S = START_UTC_S + np.linspace(5.0, 50.0, 12)


def test_agreeing_clocks_give_the_vehicle_s(tmp_path: Path) -> None:
    choice = choose_time_base(flight_telemetry(tmp_path), TimeBase.AUTO, FRAMES_S)
    assert choice.base is TimeBase.VEHICLE
    assert "agree" in choice.why
    assert choice.vehicle_offset_s == pytest.approx(-0.01, abs=0.01)


@pytest.mark.parametrize(
    ("record_error_s", "system_time_error_s", "expected"),
    [
        (0.0, 3 * DAY_S, TimeBase.RECORD),
        (-3 * DAY_S, 0.0, TimeBase.VEHICLE),
        (0.0, 2.8e10, TimeBase.RECORD),
        (0.0, 400.0, TimeBase.RECORD),
    ],
)
def test_the_frames_are_the_best_witness(
    tmp_path: Path, record_error_s: float, system_time_error_s: float, expected: TimeBase
) -> None:
    plan = FlightPlan(record_error_s=record_error_s, system_time_error_s=system_time_error_s)
    choice = choose_time_base(flight_telemetry(tmp_path, plan), TimeBase.AUTO, FRAMES_S)
    assert choice.base is expected
    assert "100% of the frame times" in choice.why
    assert choice.vehicle_offset_s == pytest.approx(system_time_error_s - record_error_s, abs=0.05)


@pytest.mark.parametrize(
    ("plan", "expected", "words"),
    [
        (FlightPlan(system_time_error_s=None), TimeBase.RECORD, "no usable SYSTEM_TIME"),
        (FlightPlan(system_time_error_s=2.8e10), TimeBase.RECORD, "the year 29"),
        (FlightPlan(record_error_s=100.0 - START_UTC_S), TimeBase.VEHICLE, "the year 1970"),
        (FlightPlan(system_time_error_s=16.0), TimeBase.VEHICLE, "nothing tells"),
    ],
)
def test_without_frames_plausibility_decides(
    tmp_path: Path, plan: FlightPlan, expected: TimeBase, words: str
) -> None:
    choice = choose_time_base(flight_telemetry(tmp_path, plan))
    assert choice.base is expected
    assert words in choice.why
    assert "\n" not in choice.why


def test_a_record_clock_that_was_set_back_is_not_believed(tmp_path: Path) -> None:
    first = FlightPlan()
    second = FlightPlan(
        start_utc_s=START_UTC_S + 3600.0, record_error_s=-3590.0, boot_before_start_s=20.0
    )
    telemetry = flight_telemetry(tmp_path, first, second)
    choice = choose_time_base(telemetry)
    assert choice.base is TimeBase.VEHICLE
    assert "set back" in choice.why
    assert len(log_spans_s(telemetry, choice.clock)) == 2


def test_the_user_has_the_last_word(tmp_path: Path) -> None:
    telemetry = flight_telemetry(tmp_path, FlightPlan(system_time_error_s=2.8e10))
    forced = choose_time_base(telemetry, TimeBase.VEHICLE, FRAMES_S)
    assert forced.base is TimeBase.VEHICLE
    assert forced.why == "vehicle clock: asked for"
    silent = flight_telemetry(tmp_path, FlightPlan(system_time_error_s=None))
    with pytest.raises(FrameTimesError, match="--time-base record"):
        choose_time_base(silent, TimeBase.VEHICLE)


def test_a_reboot_starts_a_session_and_a_late_packet_does_not(tmp_path: Path) -> None:
    first = FlightPlan(duration_s=20.0)
    late = FlightPlan(START_UTC_S + 18.5, 10.0, 58.5)
    rebooted = FlightPlan(START_UTC_S + 60.0, 20.0, 30.0)
    telemetry = flight_telemetry(tmp_path, first, late, rebooted)
    sessions = find_sessions(telemetry)
    assert len(sessions) == 2
    clock = Clock(TimeBase.RECORD, sessions)
    spans = log_spans_s(telemetry, clock)
    np.testing.assert_allclose(
        spans,
        START_UTC_S + np.array([[0.0, 28.3], [60.0, 79.8]]),
        atol=0.05,
    )


def test_a_ground_station_clock_that_is_set_in_flight(tmp_path: Path) -> None:
    """A computer without a battery-backed clock starts in 1970 and learns the time by network."""
    wrong = FlightPlan(duration_s=20.0, record_error_s=500.0 - START_UTC_S, delay_s=0.5)
    right = FlightPlan(START_UTC_S + 20.0, 40.0, 60.0, delay_s=0.5)
    telemetry = flight_telemetry(tmp_path, wrong, right)
    sessions = find_sessions(telemetry)
    assert len(sessions) == 2
    record_s = Clock(TimeBase.RECORD, sessions).utc_s(telemetry.positions.stamps)
    true_s = START_UTC_S + 0.2 * np.arange(300)
    np.testing.assert_allclose(record_s[100:], true_s[100:] + 0.25, atol=0.06)
    np.testing.assert_allclose(record_s[:100], true_s[:100] + 500.25 - START_UTC_S, atol=0.06)
    vehicle_s = Clock(TimeBase.VEHICLE, sessions).utc_s(telemetry.positions.stamps)
    np.testing.assert_allclose(vehicle_s, true_s, atol=1e-3)


def test_bursts_of_the_radio_do_not_move_the_record_clock(tmp_path: Path) -> None:
    telemetry = flight_telemetry(tmp_path, FlightPlan(delay_s=0.8, system_time_error_s=None))
    stamps = telemetry.positions.stamps
    smooth_s = Clock(TimeBase.RECORD, find_sessions(telemetry)).utc_s(stamps)
    np.testing.assert_allclose(np.diff(smooth_s), 0.2, atol=1e-3)
    assert np.diff(stamps.record_s).std() > 0.2


def test_drift_between_the_clocks_is_followed(tmp_path: Path) -> None:
    telemetry = flight_telemetry(tmp_path, FlightPlan(duration_s=600.0, system_time_error_s=None))
    stamps = telemetry.positions.stamps
    drifting_s = stamps.record_s + 1e-3 * (stamps.record_s - START_UTC_S)
    telemetry = replace(
        telemetry,
        positions=replace(telemetry.positions, stamps=replace(stamps, record_s=drifting_s)),
        attitudes=replace(telemetry.attitudes, stamps=replace(stamps, record_s=drifting_s)),
    )
    clock = Clock(TimeBase.RECORD, find_sessions(telemetry))
    error_s = clock.utc_s(telemetry.positions.stamps) - drifting_s
    assert np.abs(error_s).max() < 0.05


def test_messages_without_boot_time_are_dated_by_their_arrival(tmp_path: Path) -> None:
    telemetry = flight_telemetry(tmp_path, FlightPlan(record_error_s=500.0))
    stamps = telemetry.positions.stamps
    bare = replace(stamps, boot_s=np.full(len(stamps), math.nan))
    clock = Clock(TimeBase.VEHICLE, find_sessions(telemetry))
    np.testing.assert_allclose(clock.utc_s(bare), clock.utc_s(stamps), atol=0.02)


def test_shares() -> None:
    times_s: FloatArray = np.array([1.0, 2.0, 3.0, 10.0])
    assert covered_share(times_s, [(0.0, 2.5), (9.0, 11.0)]) == 0.75
    assert covered_share(times_s, []) == 0.0


def smoothness_m(lat_lon_deg: FloatArray, times_s: FloatArray) -> float:
    """Return the scatter of single steps about the local speed, metres rms."""
    north_m = (lat_lon_deg[:, 0] - lat_lon_deg[0, 0]) * 110_950.0
    east_m = (lat_lon_deg[:, 1] - lat_lon_deg[0, 1]) * 111_320.0 * math.cos(math.radians(-35.36))
    steps_m = np.hypot(np.diff(north_m), np.diff(east_m))
    gaps_s = np.diff(times_s)
    speed_m_s = np.convolve(steps_m, np.ones(15), "same") / np.convolve(gaps_s, np.ones(15), "same")
    inner = slice(10, -10)
    return float(np.sqrt(np.mean((steps_m - speed_m_s * gaps_s)[inner] ** 2)))


def test_smooth_clock_straightens_a_real_flight(shared_dir: Path) -> None:
    telemetry = read_telemetry(shared_dir / "flights" / "canberra_2018_colour" / "flight.tlog")
    positions = telemetry.positions
    flown = positions.height_m > 60.0
    lat_lon_deg = np.column_stack([positions.lat_deg, positions.lon_deg])[flown]
    clock = Clock(TimeBase.RECORD, find_sessions(telemetry))
    raw_m = smoothness_m(lat_lon_deg, positions.stamps.record_s[flown])
    smooth_m = smoothness_m(lat_lon_deg, clock.utc_s(positions.stamps)[flown])
    assert smooth_m < 0.2 * raw_m
