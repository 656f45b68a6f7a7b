"""A good run: same bytes for the same inputs, a full record, silence where it is asked for."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from small_flight import Flight

from uasthn_cli import __version__
from uasthn_cli.commands.main import main


def record(out: Path) -> dict[str, Any]:
    """Return the run record of a results folder."""
    loaded: dict[str, Any] = json.loads((out / "run.json").read_text(encoding="utf-8"))
    return loaded


@pytest.mark.parametrize("sampling", ["random", "grid"])
def test_same_inputs_same_bytes(flight: Flight, tmp_path: Path, sampling: str) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for out in (first, second):
        result = CliRunner().invoke(main, flight.arguments(out, "--crop-sampling", sampling))
        assert result.exit_code == 0, result.stderr
    for name in ("frames.csv", "frames.geojson"):
        assert (first / name).read_bytes() == (second / name).read_bytes()
    untimed = [record(out) | {"timing": None} for out in (first, second)]
    assert untimed[0] == untimed[1]


def test_another_seed_draws_other_crops(flight: Flight, tmp_path: Path) -> None:
    for seed in ("1", "2"):
        arguments = flight.arguments(tmp_path / seed, "--seed", seed)
        assert CliRunner().invoke(main, arguments).exit_code == 0
    tables = [(tmp_path / seed / "frames.csv").read_bytes() for seed in ("1", "2")]
    assert tables[0] != tables[1]


def test_record_says_what_was_run(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = flight.arguments(out, "--truth", str(flight.truth), "--max-std", "4px")
    assert CliRunner().invoke(main, arguments).exit_code == 0
    run = record(out)
    assert run["version"] == __version__
    assert run["arguments"]["config"]["decision"]["max_std_px"] == 4.0
    assert run["arguments"]["config"]["search_radius_m"] == 40.0
    assert run["camera"]["hfov_deg"] == 45.0
    assert run["time_base"]["base"] == "record"
    assert "4 of 4 frames" in run["frame_times"]
    assert run["counts"]["frames"] == 4
    hashes = [run["inputs"][name]["sha256"] for name in ("log", "map", "frames", "truth")]
    assert len({len(digest) for digest in hashes}) == 1
    assert len(set(hashes)) == 4
    stages = run["timing"]["stages"]
    assert {"log", "decode", "rectify", "map", "features", "search", "write"} <= set(stages)


def test_progress_and_summary_are_on_stderr(flight: Flight, tmp_path: Path) -> None:
    result = CliRunner().invoke(main, flight.arguments(tmp_path / "out"))
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert lines[3] == "geo-tagging: 4 of 4"
    assert "of 4 frames accepted" in lines[4]


def test_quiet_run_says_nothing(flight: Flight, tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["-q", *flight.arguments(tmp_path / "out")])
    assert result.exit_code == 0
    assert result.output == ""


def test_verbose_run_says_which_clock_was_believed(flight: Flight, tmp_path: Path) -> None:
    result = CliRunner().invoke(main, [*flight.arguments(tmp_path / "out"), "-v"])
    assert "time base: record clock" in result.stderr


def test_frame_times_from_a_table(flight: Flight, tmp_path: Path) -> None:
    """Without their names, frames need a table; with it, they are found where they were."""
    rows = ["frame,time"]
    for k, name in enumerate(flight.names):
        seconds = int(name.removeprefix("frame_").removesuffix(".png")) / 1000
        (flight.frames / name).rename(flight.frames / f"picture_{k}.png")
        rows.append(f"picture_{k}.png,{seconds}")
    table = tmp_path / "times.csv"
    out = tmp_path / "out"
    refused = CliRunner().invoke(main, flight.arguments(out))
    assert refused.exit_code == 13
    assert "--frame-times" in refused.stderr
    assert not out.exists()
    table.write_text("\n".join(rows) + "\n", encoding="utf-8")
    result = CliRunner().invoke(main, flight.arguments(out, "--frame-times", str(table)))
    assert result.exit_code == 0, result.stderr
    assert record(out)["counts"]["with_estimate"] == 4
    assert record(out)["inputs"]["frame_times"]["path"] == str(table)
