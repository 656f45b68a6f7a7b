"""Reading and writing .tlog files, whole and damaged."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from simple_flight_log import (
    START_UTC_S,
    TAKE_OFF_AMSL_M,
    FlightPlan,
    flight_telemetry,
    true_lat_lon_deg,
    write_attitude,
    write_flight,
    write_position,
)

from uasthn_cli.config import PriorConfig
from uasthn_cli.errors import LogUnreadableError, NoPositionError, OutputError, UasthnError
from uasthn_cli.ingest.mavlink import TlogWriter, read_telemetry
from uasthn_cli.ingest.priors import build_priors
from uasthn_cli.types import FrameFile


@pytest.fixture(scope="module")
def log_bytes(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("log") / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log, FlightPlan(duration_s=8.0))
    return path.read_bytes()


def test_what_was_written_is_read(tmp_path: Path) -> None:
    telemetry = flight_telemetry(tmp_path)
    stamps = telemetry.positions.stamps
    assert telemetry.vehicle == (1, 1)
    assert telemetry.positions.message == "GLOBAL_POSITION_INT"
    assert len(stamps) == len(telemetry.attitudes.stamps) == 300
    assert len(telemetry.system_times.stamps) == 60
    assert stamps.boot_s[0] == pytest.approx(40.0)
    assert 0.0 <= stamps.record_s[0] - START_UTC_S <= 0.02 + 1e-6
    lat_deg, lon_deg = true_lat_lon_deg(START_UTC_S + 10.0)
    assert telemetry.positions.lat_deg[50] == pytest.approx(lat_deg, abs=1e-7)
    assert telemetry.positions.lon_deg[50] == pytest.approx(lon_deg, abs=1e-7)
    assert telemetry.positions.height_m[50] == pytest.approx(120.0)
    assert telemetry.positions.alt_amsl_m[50] == pytest.approx(120.0 + TAKE_OFF_AMSL_M)
    assert telemetry.positions.altitude_source == "GLOBAL_POSITION_INT.alt"


def test_an_altitude_of_zero_throughout_is_none(tmp_path: Path) -> None:
    positions = flight_telemetry(tmp_path, FlightPlan(amsl_m=None)).positions
    assert np.isnan(positions.alt_amsl_m).all()
    assert positions.altitude_source == "none"
    assert positions.height_m[0] == pytest.approx(120.0)


def test_records_are_big_endian_microseconds_and_mavlink_2(log_bytes: bytes) -> None:
    assert int.from_bytes(log_bytes[:8], "big") * 1e-6 == pytest.approx(START_UTC_S, abs=0.03)
    assert log_bytes[8] == 0xFD


def test_zero_positions_before_a_fix_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        for index in range(10):
            fields = {"lat": 0, "lon": 0, "alt": 0, "relative_alt": 300, "hdg": 0}
            speeds = {"vx": 0, "vy": 0, "vz": 0}
            boot_ms = 1000 + 200 * index
            log.write(
                START_UTC_S + index / 5.0 - 10.0,
                "GLOBAL_POSITION_INT",
                time_boot_ms=boot_ms,
                **fields,
                **speeds,
            )
        write_flight(log)
    assert len(read_telemetry(path).positions.stamps) == 300


def test_the_vehicle_with_most_positions_is_used(tmp_path: Path) -> None:
    few = FlightPlan(duration_s=5.0)
    path = tmp_path / "flight.tlog"
    with TlogWriter(path, system=3) as log:
        write_flight(log)
    with TlogWriter(tmp_path / "other.tlog", system=7) as log:
        write_flight(log, few)
    path.write_bytes((tmp_path / "other.tlog").read_bytes() + path.read_bytes())
    telemetry = read_telemetry(path)
    assert telemetry.vehicle == (3, 1)
    assert len(telemetry.positions.stamps) == 300


def test_gps_raw_int_stands_in_for_missing_positions(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        for index in range(20):
            utc_s = START_UTC_S + index
            lat_deg, lon_deg = true_lat_lon_deg(utc_s)
            log.write(
                utc_s,
                "GPS_RAW_INT",
                time_usec=(40 + index) * 1_000_000,
                fix_type=3 if index >= 5 else 1,
                lat=round(lat_deg * 1e7),
                lon=round(lon_deg * 1e7),
                alt=400_000 + 10_000 * index,
                eph=90,
                epv=90,
                vel=0,
                cog=0,
                satellites_visible=9,
            )
            write_attitude(log, utc_s, (40 + index) * 1000, utc_s)
    positions = read_telemetry(path).positions
    assert positions.message == "GPS_RAW_INT"
    assert positions.height_source == "gps_altitude_above_first_fix"
    np.testing.assert_allclose(positions.height_m, 10.0 * np.arange(15))
    assert positions.altitude_source == "GPS_RAW_INT.alt"
    np.testing.assert_allclose(positions.alt_amsl_m, 450.0 + 10.0 * np.arange(15))


def test_mavlink_1_is_read(tmp_path: Path) -> None:
    path = tmp_path / "old.tlog"
    sender = dialect.MAVLink(None, 1, 1)
    records = bytearray()
    for index in range(30):
        utc_s = START_UTC_S + index / 5.0
        lat_deg, lon_deg = true_lat_lon_deg(utc_s)
        boot_ms = 1000 + 200 * index
        messages = (
            dialect.MAVLink_global_position_int_message(
                boot_ms, round(lat_deg * 1e7), round(lon_deg * 1e7), 0, 9000, 0, 0, 0, 0
            ),
            dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        )
        for message in messages:
            stamp = round(utc_s * 1e6).to_bytes(8, "big")
            records += stamp + message.pack(sender, force_mavlink1=True)
    path.write_bytes(bytes(records))
    assert records[8] == 0xFE
    assert len(read_telemetry(path).positions.stamps) == 30


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\xa3\x95\x80" * 50, "dataflash"),
        (b"FMT, 128, 89, FMT, BBnNZ", "dataflash"),
        (b"ULog\x01\x12\x35" + bytes(50), "PX4 ULog"),
        (gzip.compress(b"x" * 100), "gzip"),
        (b"\xfd" + bytes(60), "without the times"),
        (b"not a log at all\n" * 100, "not a MAVLink .tlog"),
        (bytes(5000), "not a MAVLink .tlog"),
    ],
)
def test_other_files_are_refused_by_name(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(content)
    with pytest.raises(LogUnreadableError, match=words) as caught:
        read_telemetry(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_real_packets_without_times_are_raw_mavlink(tmp_path: Path, log_bytes: bytes) -> None:
    raw, position = b"", 0
    while position < len(log_bytes):
        size = log_bytes[position + 9] + 12  # MAVLink 2, unsigned
        raw += log_bytes[position + 8 : position + 8 + size]
        position += 8 + size
    path = tmp_path / "flight.tlog"
    path.write_bytes(raw)
    with pytest.raises(LogUnreadableError, match="without the times"):
        read_telemetry(path)


def test_missing_files_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogUnreadableError, match="does not exist"):
        read_telemetry(tmp_path / "nothing.tlog")
    with pytest.raises(LogUnreadableError, match="folder"):
        read_telemetry(tmp_path)


def test_a_log_without_position_or_attitude_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log, FlightPlan(attitude=False))
    with pytest.raises(NoPositionError, match="no ATTITUDE"):
        read_telemetry(path)
    with TlogWriter(path) as log:
        write_attitude(log, START_UTC_S, 1000, START_UTC_S)
    with pytest.raises(NoPositionError, match="no valid position"):
        read_telemetry(path)


def test_garbage_between_records_costs_only_its_neighbours(tmp_path: Path) -> None:
    first, second = tmp_path / "first.tlog", tmp_path / "second.tlog"
    for path, start_s in ((first, 0.0), (second, 8.0)):
        with TlogWriter(path) as log:
            write_flight(log, FlightPlan(START_UTC_S + start_s, 8.0, 40.0 + start_s))
    garbage = np.random.default_rng(1).bytes(3001)
    path = tmp_path / "flight.tlog"
    path.write_bytes(first.read_bytes()[:-5] + garbage + second.read_bytes())
    telemetry = read_telemetry(path)
    found = len(telemetry.positions.stamps) + len(telemetry.attitudes.stamps)
    assert found == 160 - 1


@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_damage_never_raises_anything_but_a_clear_error(
    log_bytes: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = bytearray(log_bytes[: data.draw(st.integers(0, len(log_bytes)))])
    places = st.integers(0, max(0, len(content) - 1))
    for place, value in data.draw(st.lists(st.tuples(places, st.integers(0, 255)), max_size=60)):
        if content:
            content[place] = value
    path = tmp_path_factory.getbasetemp() / "damaged.tlog"
    path.write_bytes(bytes(content))
    frame = FrameFile(f"{round((START_UTC_S + 4.0) * 1000)}.png", path)
    try:
        telemetry = read_telemetry(path)
        (result,) = build_priors(telemetry, [frame], config=PriorConfig()).results
    except UasthnError as error:
        assert "\n" not in str(error)
    else:
        assert 1 <= len(telemetry.positions.stamps) <= 40
        assert result.frame == frame


@given(place=st.integers(0, 3000), length=st.integers(1, 40))
@example(place=0, length=38)  # what is left begins with a packet, as raw MAVLink does
@settings(max_examples=50, deadline=None)
def test_missing_bytes_cost_a_few_records(
    log_bytes: bytes, tmp_path_factory: pytest.TempPathFactory, place: int, length: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "shortened.tlog"
    path.write_bytes(log_bytes[:place] + log_bytes[place + length :])
    telemetry = read_telemetry(path)
    # a cut of 40 bytes takes two records; where a false start byte is left, the false length behind
    # it swallows up to 280 bytes more, which is eight
    assert len(telemetry.positions.stamps) + len(telemetry.attitudes.stamps) >= 80 - 10


def test_a_failed_write_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"

    def write_half() -> None:
        with TlogWriter(path) as log:
            write_position(log, START_UTC_S, 1000, START_UTC_S)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert list(tmp_path.iterdir()) == []


def test_unwritable_places_and_unknown_messages_are_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"), TlogWriter(tmp_path / "no" / "x.tlog"):
        pass
    with TlogWriter(tmp_path / "x.tlog") as log, pytest.raises(ValueError, match="NONSENSE"):
        log.write(START_UTC_S, "NONSENSE")
