import os
from dataclasses import replace
from pathlib import Path

import pytest
from frame_results import (
    listing,
    make_failure,
    make_fix,
    make_located,
    make_record,
    make_rejected,
    truth_table,
)

from uasthn_cli.errors import OutputError
from uasthn_cli.outputs.journal import JOURNAL_NAME, LOCATED, Journal
from uasthn_cli.outputs.run_writer import folder_of_log, prepare_output, write_run
from uasthn_cli.outputs.truth import read_truth
from uasthn_cli.types import FrameResult

RESULTS: list[FrameResult] = [make_fix(), make_rejected(), make_failure()]
FILES = ["frames.csv", "frames.geojson", "run.json"]


def write(folder: Path, results: list[FrameResult] = RESULTS) -> None:
    write_run(folder, results, make_record(), None, None)


def test_writes_three_files_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    prepare_output(out, overwrite=False)
    assert listing(out) == []
    write(out)
    assert listing(out) == FILES


def test_identical_runs_are_byte_identical_but_for_timing(tmp_path: Path) -> None:
    truth_path = tmp_path / "truth.csv"
    truth_path.write_text(truth_table({"frame": "a.png"}))
    truth = read_truth(truth_path)
    record = replace(make_record(), timing=replace(make_record().timing, wall_s=77.0))
    for name, one in (("one", make_record()), ("two", record)):
        prepare_output(tmp_path / name, overwrite=False)
        write_run(tmp_path / name, RESULTS, one, truth, "EPSG:32640")
    for name in FILES[:2]:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_finished_results_need_overwrite_and_stay_until_replaced(tmp_path: Path) -> None:
    write(tmp_path)
    before = {name: (tmp_path / name).read_bytes() for name in FILES}
    with pytest.raises(OutputError, match=r"already holds results \(frames\.csv, .*--overwrite"):
        prepare_output(tmp_path, overwrite=False)
    prepare_output(tmp_path, overwrite=True)
    assert {name: (tmp_path / name).read_bytes() for name in FILES} == before
    write(tmp_path, RESULTS[:1])
    assert (tmp_path / "frames.csv").read_bytes() != before["frames.csv"]


@pytest.mark.parametrize("name", FILES)
def test_a_single_file_of_that_name_is_not_replaced_unasked(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("somebody's")
    with pytest.raises(OutputError, match=name):
        prepare_output(tmp_path, overwrite=False)
    assert (tmp_path / name).read_text() == "somebody's"


def test_an_interrupted_run_goes_on_without_overwrite(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(make_located())
    prepare_output(tmp_path, overwrite=False)
    (tmp_path / "frames.csv").write_text("written just before the crash")
    prepare_output(tmp_path, overwrite=False)
    with Journal(tmp_path, "f", LOCATED) as journal:
        assert list(journal.finished) == ["a.png"]


def test_a_journal_does_not_open_finished_results(tmp_path: Path) -> None:
    write(tmp_path)
    Journal(tmp_path, "f", LOCATED).close()
    with pytest.raises(OutputError, match="already holds results"):
        prepare_output(tmp_path, overwrite=False)


def test_other_files_in_the_folder_are_no_obstacle_and_stay(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    prepare_output(tmp_path, overwrite=False)
    write(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_file_or_a_place_below_a_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("x")
    with pytest.raises(OutputError, match="is a file"):
        prepare_output(path, overwrite=True)
    with pytest.raises(OutputError, match=r"cannot create .*below: Not a directory"):
        prepare_output(path / "below", overwrite=False)
    assert path.read_text() == "x"


@pytest.mark.skipif(not Path("/proc/version").exists(), reason="needs a read-only file system")
def test_a_read_only_file_system_is_refused_before_any_work() -> None:
    with pytest.raises(OutputError, match="cannot create /proc/uasthn"):
        prepare_output(Path("/proc/uasthn"), overwrite=False)
    with pytest.raises(OutputError, match="cannot write to /proc"):
        prepare_output(Path("/proc"), overwrite=False)


def test_half_written_files_of_a_killed_run_are_cleared(tmp_path: Path) -> None:
    (tmp_path / ".frames.csv.4711.tmp").write_text("half")
    prepare_output(tmp_path, overwrite=False)
    assert listing(tmp_path) == []


def test_a_failing_write_leaves_the_earlier_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path)
    before = {name: (tmp_path / name).read_bytes() for name in FILES}
    calls: list[int] = []

    def third_fails(handle: int) -> None:
        calls.append(handle)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", third_fails)
    with pytest.raises(OutputError, match="No space left"):
        write(tmp_path, RESULTS[:1])
    assert {name: (tmp_path / name).read_bytes() for name in FILES} == before
    assert listing(tmp_path) == FILES


def test_a_folder_that_nobody_named_must_be_new(tmp_path: Path) -> None:
    out = tmp_path / folder_of_log(Path("logs/2024 flight.tlog"))
    assert out.name == "2024 flight-geotag"
    prepare_output(out, overwrite=False, is_named=False)
    prepare_output(out, overwrite=False, is_named=False)
    (out / "notes.txt").write_text("mine")
    prepare_output(out, overwrite=False)
    prepare_output(out, overwrite=True, is_named=False)
    with pytest.raises(OutputError, match="not empty"):
        prepare_output(out, overwrite=False, is_named=False)
    (out / JOURNAL_NAME).write_text("of an interrupted run")
    prepare_output(out, overwrite=False, is_named=False)
