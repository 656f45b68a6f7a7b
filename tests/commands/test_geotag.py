"""A good run: same bytes for the same inputs, a full record, silence where it is asked for."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from frame_results import UNCERTAIN_DETAIL, make_failure, make_fix, make_rejected
from small_flight import Flight

from uasthn_cli.commands.geotag import say_summary
from uasthn_cli.commands.main import main
from uasthn_cli.types import FrameResult
from uasthn_cli.uncertainty.calibration import Calibration, Judgement
from uasthn_cli.uncertainty.risk_model import RiskModel, SignalTerm, Transform
from uasthn_cli.version import code_version


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
    assert run["version"] == code_version()
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
    assert lines[:4] == [f"geo-tagging: {k} of 4" for k in range(1, 5)]
    assert lines[4:8] == [f"refining: {k} of 4" for k in range(1, 5)]
    assert lines[8].startswith("Answers are judged by plain limits")
    assert "of 4 frames accepted" in lines[9]


@pytest.mark.parametrize(
    ("arguments", "is_said"),
    [((), True), (("--calibration", "none"), False)],
    ids=["default", "none"],
)
def test_a_missing_calibration_is_told_unless_it_was_asked_for(
    flight: Flight, tmp_path: Path, arguments: tuple[str, ...], is_said: bool
) -> None:
    out = tmp_path / "out"
    result = CliRunner().invoke(main, flight.arguments(out, *arguments))
    assert ("judged by plain limits" in result.stderr) == is_said
    assert record(out)["calibration"] is None


def test_reasons_are_told_with_an_example_each(capsys: pytest.CaptureFixture[str]) -> None:
    rejected = [make_rejected("b.png"), make_rejected("c.png")]
    results: list[FrameResult] = [make_fix(), *rejected, make_failure("d.png")]
    say_summary(results)
    assert capsys.readouterr().err.splitlines() == [
        "1 of 4 frames accepted",
        "Not accepted: 2 uncertain, 1 unreadable",
        f"  uncertain, for example b.png: {UNCERTAIN_DETAIL}",
        "  unreadable, for example d.png: truncated PNG",
    ]


def test_each_frame_alone(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = CliRunner().invoke(main, flight.arguments(out, "--no-fuse"))
    assert result.exit_code == 0, result.stderr
    assert "refining" not in result.stderr
    assert record(out)["flight"] is None
    header, first = (out / "frames.csv").read_text().splitlines()[:2]
    assert "single_" not in header
    assert ",fix," in first


def test_the_flights_answer_beside_each_frames_own(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = flight.arguments(out, "--truth", str(flight.truth))
    assert CliRunner().invoke(main, arguments).exit_code == 0
    with (out / "frames.csv").open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    for row in rows:
        assert row["source"] == "fused"
        assert float(row["ce_m"]) < 1.0
        assert float(row["single_ce_m"]) < 1.0
        assert 0.0 < float(row["ce90_m"]) < 25.0
    flight_section = record(out)["flight"]
    assert flight_section["diffusion_m_per_sqrt_s"] > 0
    assert set(flight_section) == {
        *("diffusion_m_per_sqrt_s", "mount_yaw_deg", "height_log_scale", "clock_s", "poses"),
    }


def test_answers_are_judged_by_a_calibration(flight: Flight, tmp_path: Path) -> None:
    """One that accepts no risk at all rejects every frame as risky."""
    term = SignalTerm("confidence", Transform.LOGIT, mean=0.0, deviation=1.0, weight=-1.0)
    judgement = Judgement(RiskModel((term,), 0.0), 0.0, 1.5, 90, 100, 0, 0, 0)
    strict = Calibration(25.0, 0.05, 0.9, judgement, None, note="none is good enough")
    path = tmp_path / "strict.json"
    path.write_text(json.dumps(strict.to_json()))
    out = tmp_path / "out"
    result = CliRunner().invoke(main, flight.arguments(out, "--calibration", str(path)))
    assert result.exit_code == 0, result.stderr
    assert "0 of 4 frames accepted" in result.stderr
    assert record(out)["counts"]["reasons"] == {"risky": 4}
    assert record(out)["calibration"]["note"] == "none is good enough"


def test_a_damaged_calibration_is_refused(flight: Flight, tmp_path: Path) -> None:
    path, out = tmp_path / "calibration.json", tmp_path / "out"
    path.write_text("{}")
    result = CliRunner().invoke(main, flight.arguments(out, "--calibration", str(path)))
    assert result.exit_code == 25
    assert str(path) in result.stderr
    assert not out.exists()


def test_the_maps_own_error_is_part_of_every_radius(flight: Flight, tmp_path: Path) -> None:
    radii_m = []
    for name, error_m in (("exact", "0"), ("loose", "20")):
        arguments = flight.arguments(tmp_path / name, "--map-error", error_m)
        assert CliRunner().invoke(main, arguments).exit_code == 0
        with (tmp_path / name / "frames.csv").open(newline="") as handle:
            radii_m.append([float(row["ce90_m"]) for row in csv.DictReader(handle)])
    map_ce90_m = 20.0 * math.sqrt(2.0 * math.log(10.0))
    for exact_m, loose_m in zip(*radii_m, strict=True):
        assert loose_m == pytest.approx(math.hypot(exact_m, map_ce90_m), abs=0.01)


def test_the_error_of_the_attitude_is_the_cameras_alone(flight: Flight, tmp_path: Path) -> None:
    rows = {}
    for error_deg in ("0", "2"):
        out = tmp_path / error_deg
        arguments = flight.arguments(out, "--attitude-error", error_deg)
        assert CliRunner().invoke(main, arguments).exit_code == 0
        with (out / "frames.csv").open(newline="") as handle:
            rows[error_deg] = list(csv.DictReader(handle))
        notes = record(out)["notes"]
        assert notes["altitude_source"] == "GLOBAL_POSITION_INT.alt"
        assert notes["attitude_source"] == "attitude"
    for sure, unsure in zip(rows["0"], rows["2"], strict=True):
        assert sure["camera_ce90_m"] == sure["ce90_m"] == unsure["ce90_m"]
        tilt_m = math.radians(2.0) * float(unsure["agl_m"]) * math.sqrt(2.0 * math.log(10.0))
        expected_m = math.hypot(float(sure["ce90_m"]), tilt_m)
        assert float(unsure["camera_ce90_m"]) == pytest.approx(expected_m, abs=0.01)


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


def test_without_a_folder_results_go_to_a_new_one_named_by_the_log(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = flight.arguments(tmp_path / "unused")
    where = arguments.index("--out")
    del arguments[where : where + 2]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.stderr
    assert f"Results are in {flight.log.stem}-geotag" in result.stderr
    assert record(tmp_path / f"{flight.log.stem}-geotag")["counts"]["frames"] == 4
    again = CliRunner().invoke(main, arguments)
    assert again.exit_code == 18
    assert "--overwrite" in again.stderr
