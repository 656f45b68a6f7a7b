"""Where capture times come from, and in which order."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from simple_flight_log import START_UTC_S, FlightPlan, make_frame_files, write_flight

from uasthn_cli.config import PairBy
from uasthn_cli.errors import FrameTimesError
from uasthn_cli.ingest.frame_table import read_frame_table
from uasthn_cli.ingest.frame_times import FrameTimes, frame_times, in_zone_of_log, stated_times
from uasthn_cli.ingest.frames import list_frames
from uasthn_cli.ingest.mavlink import TlogWriter, read_telemetry
from uasthn_cli.ingest.telemetry import Telemetry
from uasthn_cli.ingest.timebase import choose_time_base
from uasthn_cli.types import FrameFile

TIMES_S = [START_UTC_S + 3.0 * k for k in range(1, 11)]


def frame_files(*names: str) -> list[FrameFile]:
    return [FrameFile(name, Path("/nowhere") / name) for name in names]


def log_with_feedback(folder: Path, exposures_s: list[float], first_index: int = 0) -> Telemetry:
    """Write a flight whose camera reported these exposures."""
    path = folder / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log, FlightPlan(record_error_s=50.0))
        for index, time_s in enumerate(exposures_s, start=first_index):
            places = {"lat": 0, "lng": 0, "alt_msl": 0.0, "alt_rel": 0.0}
            angles = {"roll": 0.0, "pitch": 0.0, "yaw": 0.0, "foc_len": 0.0, "flags": 0}
            ids = {"target_system": 0, "cam_idx": 0, "img_idx": index}
            usec = round(time_s * 1e6)
            log.write(time_s + 50.7, "CAMERA_FEEDBACK", time_usec=usec, **ids, **places, **angles)
    return read_telemetry(path)


def dated(telemetry: Telemetry, frames: list[FrameFile], csv: Path | None = None) -> FrameTimes:
    return frame_times(frames, telemetry, choose_time_base(telemetry).clock, csv)


def test_names_are_enough(tmp_path: Path) -> None:
    frames = list_frames(make_frame_files(tmp_path, TIMES_S))
    found = stated_times(frames, None)
    assert found is not None
    assert found.source == "name"
    assert found.why == "times of 10 of 10 frames from file names"
    assert found.times_s == pytest.approx(TIMES_S)


def test_a_table_comes_before_everything(tmp_path: Path) -> None:
    frames = list_frames(make_frame_files(tmp_path, TIMES_S))
    csv = tmp_path / "times.csv"
    csv.write_text(f"frame,time\n{frames[2].name},{TIMES_S[5]}\n")
    found = dated(log_with_feedback(tmp_path, TIMES_S), frames, csv)
    assert found.source == "table"
    assert [t for t in found.times_s if t is not None] == [found.times_s[2]]
    assert found.times_s[2] == pytest.approx(TIMES_S[5])


def test_camera_messages_come_before_names(tmp_path: Path) -> None:
    """The camera's clock is 40 min and 1.3 s off; two files and one message are missing."""
    exposures_s = [time_s + 0.3 * (k * k % 7) for k, time_s in enumerate(TIMES_S)]
    stated_s = [time_s - 2401.3 for time_s in exposures_s]
    frames = list_frames(
        make_frame_files(tmp_path, [s for k, s in enumerate(stated_s) if k not in (2, 7)])
    )
    telemetry = log_with_feedback(tmp_path, [t for k, t in enumerate(exposures_s) if k != 4])
    found = dated(telemetry, frames)
    expected = [t for k, t in enumerate(exposures_s) if k not in (2, 7)]
    assert found.source == "camera_feedback"
    assert "7 of 8 frames" in found.why
    assert "1 more by their own clock" in found.why
    assert "2401.3 s slow" in found.why
    assert "2 of these messages have no frame" in found.why
    # dated by the vehicle's own stamps, not by their late arrival
    assert found.times_s == pytest.approx(expected, abs=0.03)


def test_counters_match_where_names_tell_no_time(tmp_path: Path) -> None:
    telemetry = log_with_feedback(tmp_path, TIMES_S, first_index=21)
    frames = frame_files(*(f"IMG_{k:04d}.png" for k in (21, 22, 24, 25, 28, 30)))
    found = dated(telemetry, frames)
    expected = [TIMES_S[k - 21] for k in (21, 22, 24, 25, 28, 30)]
    assert found.times_s == pytest.approx(expected, abs=0.03)


def test_a_pairing_that_nothing_settles_is_refused_with_the_ways_out(tmp_path: Path) -> None:
    telemetry = log_with_feedback(tmp_path, TIMES_S)
    frames = frame_files(*(f"IMG_{k:04d}.png" for k in range(1, 8)))
    with pytest.raises(FrameTimesError, match="which evidence to believe") as caught:
        dated(telemetry, frames)
    assert "7 frames numbered 1 to 7 and 10 messages numbered 0 to 9" in str(caught.value)


def test_equal_counts_match_in_order(tmp_path: Path) -> None:
    telemetry = log_with_feedback(tmp_path, TIMES_S[:3])
    found = dated(telemetry, frame_files("a.png", "b.png", "c.png"))
    assert found.times_s == pytest.approx(TIMES_S[:3], abs=0.03)


def test_camera_file_names_match_exactly(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log)
        for index, captured in ((0, 1), (1, 0), (2, 1)):
            utc_s = START_UTC_S + 5.0 + index
            log.write(
                utc_s + 0.4,
                "CAMERA_IMAGE_CAPTURED",
                time_boot_ms=round((45.0 + index) * 1000),
                time_utc=0,
                camera_id=1,
                lat=0,
                lon=0,
                alt=0,
                relative_alt=0,
                q=[1.0, 0.0, 0.0, 0.0],
                image_index=index,
                capture_result=captured,
                file_url=f"http://camera/dcim/X{index}.PNG".encode(),
            )
    found = dated(read_telemetry(path), frame_files("sub/x2.png", "x0.png", "x1.png"))
    assert found.source == "camera_image_captured"
    assert found.times_s[:2] == pytest.approx((START_UTC_S + 7.0, START_UTC_S + 5.0), abs=0.03)
    assert found.times_s[2] is None


def test_messages_that_fit_too_few_frames_are_left_alone(tmp_path: Path) -> None:
    frames = list_frames(make_frame_files(tmp_path, TIMES_S))
    found = dated(log_with_feedback(tmp_path, TIMES_S[:3]), frames)
    assert found.source == "name"
    assert "3 camera messages are left alone: fewer than half" in found.why
    telemetry = log_with_feedback(tmp_path, TIMES_S)
    clock = choose_time_base(telemetry).clock
    asked = frame_times(frames, telemetry, clock, None, PairBy.NONE)
    assert asked.source == "name"
    assert "10 camera messages are left alone: as asked" in asked.why


def test_exif_with_subseconds_and_offset(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for index, offset in enumerate(("+02:00", None)):
        exif = Image.Exif()
        detail = exif.get_ifd(0x8769)
        detail[0x9003] = "2018:08:05 03:00:44"
        detail[0x9291] = "80"
        if offset:
            detail[0x9011] = offset
        Image.new("L", (8, 6)).save(folder / f"{index}.jpg", exif=exif)
    found = stated_times(list_frames(folder), None)
    expected_s = datetime(2018, 8, 5, 1, 0, 44, 800_000, UTC).timestamp()
    assert found is not None
    assert found.source == "exif"
    assert found.times_s == pytest.approx((expected_s, expected_s + 7200.0))


def test_no_source_names_the_three_ways_out(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        write_flight(log)
    with pytest.raises(FrameTimesError) as caught:
        dated(read_telemetry(path), frame_files("a.png", "b.png"))
    for words in ("a.png", "--frame-times", "rename", "CAMERA_FEEDBACK"):
        assert words in str(caught.value)


def test_local_times_move_into_the_log_by_whole_zones_only() -> None:
    spans = [(START_UTC_S, START_UTC_S + 60.0)]
    local = FrameTimes(tuple(t + 5.5 * 3600 for t in TIMES_S), "name", "names", is_local=True)
    moved = in_zone_of_log(local, spans)
    assert moved.times_s == pytest.approx(TIMES_S)
    assert "UTC+5.5 h" in moved.why
    zoned = FrameTimes(local.times_s, "name", "names", is_local=False)
    assert in_zone_of_log(zoned, spans) == zoned
    already = FrameTimes(tuple(TIMES_S), "name", "names", is_local=True)
    assert in_zone_of_log(already, spans) == already
    half = FrameTimes(tuple(t + 3600.0 for t in TIMES_S), "name", "names", is_local=True)
    long_log = [(START_UTC_S - 1800.0, TIMES_S[4] + 3600.0)]
    assert in_zone_of_log(half, long_log).times_s == pytest.approx(TIMES_S)
    elsewhere = FrameTimes(tuple(t + 86_400.0 * 9 for t in TIMES_S), "name", "n", is_local=True)
    assert in_zone_of_log(elsewhere, spans) == elsewhere


@given(
    seconds=st.lists(st.integers(0, 10**6), min_size=1, max_size=8, unique=True),
    delimiter=st.sampled_from(",;\t"),
    header=st.sampled_from([("frame", "time"), ("File", "UTC"), ("image_name", "Timestamp")]),
    form=st.sampled_from(["iso", "s", "ms", "us"]),
    swapped=st.booleans(),
)
def test_tables_in_every_common_shape(
    tmp_path_factory: pytest.TempPathFactory,
    seconds: list[int],
    delimiter: str,
    header: tuple[str, str],
    form: str,
    swapped: bool,
) -> None:
    def cell(time_s: float) -> str:
        if form == "iso":
            return (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=time_s)).isoformat()
        return str(round(time_s * {"s": 1, "ms": 1000, "us": 1_000_000}[form]))

    rows = [header, *((f"frame_{s}.png", cell(START_UTC_S + s)) for s in seconds)]
    text = "\r\n".join(delimiter.join(row[::-1] if swapped else row) for row in rows)
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    table = read_frame_table(path)
    assert {name: stated.time_s - START_UTC_S for name, stated in table.items()} == pytest.approx(
        {f"frame_{s}.png": s for s in seconds}
    )


@given(st.binary(max_size=300))
def test_any_bytes_are_a_table_or_a_clear_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "noise.csv"
    path.write_bytes(b"frame,time\n" + content)
    try:
        read_frame_table(path)
    except FrameTimesError as error:
        assert str(path) in str(error)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("a,b\n1,2\n", "needs a header with the columns frame,time; it has a,b"),
        ("frame,time\nx.png,noon\n", "line 2: 'noon' is no time"),
        ("frame,time\nother.png,1700000000\n", "names none of the 2 frames"),
    ],
)
def test_tables_that_cannot_be_used(tmp_path: Path, text: str, words: str) -> None:
    csv = tmp_path / "times.csv"
    csv.write_text(text)
    with pytest.raises(FrameTimesError, match=words):
        stated_times(frame_files("a.png", "b.png"), csv)
    with pytest.raises(FrameTimesError, match="cannot be read"):
        stated_times(frame_files("a.png"), tmp_path / "gone.csv")


def test_tables_may_name_frames_with_folders_or_without_extension(tmp_path: Path) -> None:
    csv = tmp_path / "times.csv"
    csv.write_text(
        "frame,time\nC:\\data\\A.png,1700000001\nb,1700000002\nsub/c.png,1700000003\nd.png,\n"
    )
    found = stated_times(frame_files("a.png", "b.png", "sub/c.png", "d.png"), csv)
    assert found is not None
    assert found.times_s == (1_700_000_001.0, 1_700_000_002.0, 1_700_000_003.0, None)
