"""Wrong inputs, one by one: one clear line, the documented exit code, nothing half-written.

Maps and frames that are merely unusual must work; frames that are bad must become rows.
"""

import csv
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from click.testing import CliRunner, Result
from small_flight import MAP_CRS, Flight, make_flight, write_log, write_map

from uasthn_cli.commands.main import main
from uasthn_cli.pipeline import Run

INTERRUPTIBLE = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from uasthn_cli.commands.main import main
main(prog_name="uasthn")
"""
"""The program, deaf to a parent in the background that ignores Ctrl-C and bequeathed that."""

RESULTS = ["frames.csv", "frames.geojson", "run.json"]
JOURNALS = [".frames.partial.jsonl", ".refined.partial.jsonl"]


def geotag(flight: Flight, out: Path, *extra: str) -> Result:
    """Run the command in this process."""
    return CliRunner().invoke(main, flight.arguments(out, *extra))


def rows(out: Path) -> list[dict[str, str]]:
    """Return the rows of a results folder."""
    with (out / "frames.csv").open(newline="", encoding="utf-8") as handle:
        return list(csv.DictReader(handle))


def assert_refused(result: Result, out: Path, exit_code: int, *words: str) -> None:
    """Check that a run ended in one line that holds all words, and left nothing."""
    assert result.exit_code == exit_code, result.stderr
    assert result.stdout == ""
    assert result.stderr.startswith("uasthn: error: ")
    assert result.stderr.count("\n") == 1
    for word in words:
        assert word in result.stderr
    assert not out.exists()


def assert_found(result: Result, out: Path, frames: int) -> None:
    """Check that a run ended well and found all of its frames near the truth."""
    assert result.exit_code == 0, result.stderr
    assert sorted(path.name for path in out.iterdir()) == RESULTS
    errors_m = [float(row["ce_m"]) for row in rows(out)]
    assert len(errors_m) == frames
    assert max(errors_m) < 5.0


def test_good_flight(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = geotag(flight, out, "--truth", str(flight.truth))
    assert_found(result, out, frames=4)
    assert result.stdout == ""
    assert "of 4 frames accepted" in result.stderr
    assert f"uasthn report {out}" in result.stderr


def test_log_is_no_tlog(flight: Flight, tmp_path: Path) -> None:
    flight.log.write_text("time,lat,lon\n" * 500)
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 10, "flight.tlog", "not a MAVLink")


def test_log_is_missing(flight: Flight, tmp_path: Path) -> None:
    flight.log.unlink()
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 10, "flight.tlog", "does not exist")


def test_log_is_empty(flight: Flight, tmp_path: Path) -> None:
    flight.log.write_bytes(b"")
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 10, "flight.tlog", "empty")


def test_log_without_position(flight: Flight, tmp_path: Path) -> None:
    write_log(flight.log, count=4, with_position=False)
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 11, "flight.tlog", "position")


def test_log_of_another_day(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = geotag(flight, out, "--time-offset", "86400")
    assert_refused(result, out, 11, "--time-offset")


def test_frames_folder_is_empty(flight: Flight, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    out = tmp_path / "out"
    assert_refused(geotag(replace(flight, frames=empty), out), out, 12, "empty")


def test_frames_folder_is_missing(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    nowhere = replace(flight, frames=tmp_path / "nowhere")
    assert_refused(geotag(nowhere, out), out, 12, "nowhere", "does not exist")


def truncate(frame: Path) -> None:
    """Cut a file in half."""
    content = frame.read_bytes()
    frame.write_bytes(content[: len(content) // 2])


@pytest.mark.parametrize(
    ("damage", "word"),
    [
        pytest.param(truncate, "truncated", id="truncated"),
        pytest.param(lambda frame: frame.write_text("not a picture"), "not a PNG", id="text"),
        pytest.param(lambda frame: frame.write_bytes(b""), "0 bytes", id="empty"),
    ],
)
def test_bad_frame_becomes_a_row(
    flight: Flight, tmp_path: Path, damage: Callable[[Path], None], word: str
) -> None:
    bad = flight.names[1]
    damage(flight.frames / bad)
    out = tmp_path / "out"
    result = geotag(flight, out, "--truth", str(flight.truth))
    assert result.exit_code == 0, result.stderr
    assert "1 unreadable" in result.stderr
    by_name = {row["frame"]: row for row in rows(out)}
    assert list(by_name) == flight.names
    row = by_name.pop(bad)
    assert row["reason"] == "unreadable"
    assert row["accepted"] == "false"
    assert word in row["detail"]
    assert row["lat"] == row["tl_lat"] == row["u_m"] == ""
    assert all(float(other["ce_m"]) < 5.0 for other in by_name.values())


def test_map_is_missing(flight: Flight, tmp_path: Path) -> None:
    flight.map.unlink()
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 15, "map.tif", "no such map")


def test_map_without_crs(flight: Flight, tmp_path: Path) -> None:
    write_map(flight.map, flight.ground[None], crs=None)
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 16, "map.tif", "coordinate reference system")


def test_map_is_corrupt(flight: Flight, tmp_path: Path) -> None:
    flight.map.write_bytes(b"II*\x00" + bytes(2000))
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 15, "map.tif")


def test_map_is_truncated(flight: Flight, tmp_path: Path) -> None:
    truncate(flight.map)
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 15, "map.tif")


def test_map_elsewhere_on_earth(flight: Flight, tmp_path: Path) -> None:
    write_map(flight.map, flight.ground[None], crs="EPSG:32610")
    out = tmp_path / "out"
    assert_refused(geotag(flight, out), out, 17, "map.tif", "km apart")


def test_map_in_degrees(flight: Flight, tmp_path: Path) -> None:
    in_degrees = flight.map.with_name("degrees.tif")
    with rasterio.open(flight.map) as metric:
        transform, width, height = rasterio.warp.calculate_default_transform(
            MAP_CRS, "EPSG:4326", metric.width, metric.height, *metric.bounds
        )
        profile = metric.profile | {
            "crs": "EPSG:4326",
            "transform": transform,
            "width": width,
            "height": height,
        }
        with rasterio.open(in_degrees, "w", **profile) as raster:
            for band in (1, 2, 3):
                rasterio.warp.reproject(
                    rasterio.band(metric, band),
                    rasterio.band(raster, band),
                    resampling=rasterio.warp.Resampling.cubic,
                )
    out = tmp_path / "out"
    result = geotag(replace(flight, map=in_degrees), out, "--truth", str(flight.truth))
    assert_found(result, out, frames=4)


def test_map_of_one_band_and_16_bit(flight: Flight, tmp_path: Path) -> None:
    write_map(flight.map, 30_000 + 40 * flight.ground[None].astype(np.uint16))
    out = tmp_path / "out"
    assert_found(geotag(flight, out, "--truth", str(flight.truth)), out, frames=4)


def test_map_with_alpha(flight: Flight, tmp_path: Path) -> None:
    opaque = np.full_like(flight.ground, 255)
    opaque[:, :40] = 0
    write_map(flight.map, np.stack([flight.ground] * 3 + [opaque]))
    out = tmp_path / "out"
    assert_found(geotag(flight, out, "--truth", str(flight.truth)), out, frames=4)


def test_output_below_a_file(flight: Flight, tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("not a folder")
    out = blocker / "out"
    result = geotag(flight, out)
    assert result.exit_code == 18
    assert result.stderr.startswith("uasthn: error: ")
    assert result.stderr.count("\n") == 1
    assert blocker.read_text() == "not a folder"


def test_output_is_never_replaced_unasked(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert geotag(flight, out).exit_code == 0
    before = {name: (out / name).read_bytes() for name in RESULTS}
    result = geotag(flight, out, "--seed", "7")
    assert result.exit_code == 18
    assert "--overwrite" in result.stderr
    assert {name: (out / name).read_bytes() for name in RESULTS} == before
    assert geotag(flight, out, "--seed", "7", "--overwrite").exit_code == 0
    assert (out / "run.json").read_bytes() != before["run.json"]


def test_truth_of_another_flight(flight: Flight, tmp_path: Path) -> None:
    flight.truth.write_text(flight.truth.read_text().replace("frame_", "picture_"))
    out = tmp_path / "out"
    assert_refused(geotag(flight, out, "--truth", str(flight.truth)), out, 20, "truth.csv")


@pytest.mark.parametrize(
    ("arguments", "exit_code", "words"),
    [
        (["--camera", "kodak"], 14, ["kodak", "boson640-18mm"]),
        (["--focal-mm", "13"], 14, ["pixel pitch"]),
        ([], 14, ["--hfov"]),
    ],
)
def test_camera_unknown_or_incomplete(
    flight: Flight, tmp_path: Path, arguments: list[str], exit_code: int, words: list[str]
) -> None:
    out = tmp_path / "out"
    inputs = [str(flight.log), str(flight.frames), "--map", str(flight.map), "--out", str(out)]
    result = CliRunner().invoke(main, ["geotag", *inputs, "--estimator", "ncc", *arguments])
    assert_refused(result, out, exit_code, *words)


def test_weights_that_are_none(flight: Flight, tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    weights.write_text("not weights")
    out = tmp_path / "out"
    result = geotag(flight, out, "--estimator", "xcorr", "--weights", str(weights))
    assert_refused(result, out, 19, "weights.safetensors")


def test_unknown_epsg_code_is_a_usage_error(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = geotag(flight, out, "--crs", "EPSG:999999")
    assert result.exit_code == 2
    assert "--crs" in result.stderr
    assert not out.exists()


@pytest.mark.parametrize("step", ["geo-tagging: ", "refining: "])
def test_ctrl_c_half_way_then_the_same_command_again(tmp_path: Path, step: str) -> None:
    """Interrupted and resumed, the files are those of a run that never stopped."""
    flight = make_flight(tmp_path / "flight", count=30)
    straight, resumed = tmp_path / "straight", tmp_path / "resumed"
    assert geotag(flight, straight).exit_code == 0

    interrupted = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, *flight.arguments(resumed)],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert interrupted.stderr is not None
    for line in interrupted.stderr:
        if line.startswith(step):
            interrupted.send_signal(signal.SIGINT)
            break
    rest = interrupted.stderr.read()
    assert interrupted.wait() == 130
    assert "interrupted after" in rest
    assert "same command" in rest
    assert sorted(path.name for path in resumed.iterdir()) == JOURNALS

    again = CliRunner().invoke(main, ["geotag", "-v", *flight.arguments(resumed)[1:]])
    assert again.exit_code == 0, again.stderr
    assert "taken over" in again.stderr
    assert sorted(path.name for path in resumed.iterdir()) == RESULTS
    for name in ("frames.csv", "frames.geojson"):
        assert (resumed / name).read_bytes() == (straight / name).read_bytes()


def test_ctrl_c_while_the_flight_is_fused_keeps_every_frame(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    out = tmp_path / "out"
    with monkeypatch.context() as patched:
        patched.setattr(Run, "fuse_flight", interrupted)
        result = geotag(flight, out)
    assert result.exit_code == 130
    assert "interrupted after 4 of 4 frames (0 refined)" in result.stderr
    assert sorted(path.name for path in out.iterdir()) == JOURNALS
    again = geotag(flight, out)
    assert again.exit_code == 0, again.stderr
    assert "geo-tagging" not in again.stderr
