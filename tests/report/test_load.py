from pathlib import Path

import numpy as np
import pytest
from frame_results import make_failure, make_fix, make_record, make_rejected, truth_table
from report_runs import FIVE_ROWS, fused_rows, make_run, write_folder

from uasthn_cli.errors import ResultsError
from uasthn_cli.outputs.run_writer import write_run
from uasthn_cli.outputs.truth import read_truth
from uasthn_cli.report.load import load_run, single_frame_run
from uasthn_cli.types import FrameResult


def test_reads_what_was_written(tmp_path: Path) -> None:
    run = load_run(write_folder(tmp_path / "out"))
    assert run.name == str(tmp_path / "out")
    assert (run.version, run.has_truth, run.has_prior_error) == ("0.1.0", True, True)
    assert repr(run.rows) == repr(FIVE_ROWS)


def test_reads_the_writers_own_folder(tmp_path: Path) -> None:
    (tmp_path / "truth.csv").write_text(truth_table({"frame": '"a, 1.png"'}, {"frame": "NA"}))
    truth = read_truth(tmp_path / "truth.csv")
    results: list[FrameResult] = [
        make_fix("a, 1.png"),
        make_rejected("NA"),
        make_failure("größe.png"),
    ]
    write_run(tmp_path, results, make_record(), truth, "EPSG:32640")
    run = load_run(tmp_path)
    assert [row.frame for row in run.rows] == ["a, 1.png", "NA", "größe.png"]
    assert [row.accepted for row in run.rows] == [True, False, False]
    assert [row.has_estimate for row in run.rows] == [True, True, False]
    assert [row.reason for row in run.rows] == ["", "uncertain", "unreadable"]
    assert [row.ce_m for row in run.rows[:2]] == [0.0, 0.0]
    assert np.isnan(run.rows[2].ce_m)


def test_truth_columns_may_be_absent(tmp_path: Path) -> None:
    run = load_run(write_folder(tmp_path / "out", with_truth=False))
    assert (run.has_truth, run.has_prior_error) == (False, False)
    assert np.isnan([row.ce_m for row in run.rows]).all()


def test_fused_and_single_answers_are_read(tmp_path: Path) -> None:
    written = fused_rows(3)
    run = load_run(write_folder(tmp_path / "out", written))
    single = single_frame_run(run)
    assert single is not None
    assert [row.source for row in run.rows] == ["fix", "flight", "fix"]
    for found, expected in zip(
        [*run.rows, *single.rows], [*written, *(row.single for row in written)], strict=True
    ):
        assert expected is not None
        assert (found.has_estimate, found.accepted) == (True, expected.accepted)
        for name in ("ce_m", "confidence", "entropy", "sigma_m", "u_m", "risk", "ce90_m"):
            assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=5e-4)
    assert np.isnan([row.agreement_m for row in run.rows]).all()


def test_a_frame_that_alone_has_no_answer(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out", fused_rows(2))
    table = (folder / "frames.csv").read_text(encoding="utf-8").splitlines()
    names = table[0].split(",")
    cells = table[1].split(",")
    emptied = [
        "" if name.startswith("single_") else cell for name, cell in zip(names, cells, strict=True)
    ]
    text = "\n".join([table[0], ",".join(emptied), table[2]]) + "\n"
    (folder / "frames.csv").write_text(text, encoding="utf-8")
    single = single_frame_run(load_run(folder))
    assert single is not None
    assert [row.has_estimate for row in single.rows] == [False, True]
    assert not single.rows[0].accepted


def test_nothing_fused_has_no_single_frames() -> None:
    assert single_frame_run(make_run()) is None


@pytest.mark.parametrize(
    ("column", "cell", "message"),
    [
        ("risk", "1.5", r"frames\.csv:2: risk is '1\.5', expected 0 to 1"),
        ("single_risk", "-0.1", "single_risk is '-0.1', expected 0 to 1"),
        ("entropy", "high", "entropy is 'high', expected a number"),
        ("single_ce90_m", "far", "single_ce90_m is 'far', expected metres"),
        ("single_accepted", "yes", "single_accepted is 'yes', expected true or false"),
    ],
)
def test_bad_cells_of_trust_are_refused(
    tmp_path: Path, column: str, cell: str, message: str
) -> None:
    path = write_folder(tmp_path / "out", fused_rows(1)) / "frames.csv"
    header, row = (line.split(",") for line in path.read_text(encoding="utf-8").splitlines())
    row[header.index(column)] = cell
    path.write_text(",".join(header) + "\n" + ",".join(row) + "\n", encoding="utf-8")
    with pytest.raises(ResultsError, match=message):
        load_run(tmp_path / "out")


def damaged(folder: Path, name: str, old: str, new: str) -> Path:
    path = write_folder(folder) / name
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("frames.csv", "reason,", "why,", "column reason is missing"),
        ("frames.csv", ",true,", ",yes,", r"frames\.csv:2: accepted is 'yes'"),
        ("frames.csv", ",4.000,", ",near,", r"frames\.csv:2: ce_m is 'near', expected metres"),
        (
            "frames.csv",
            "e.png,,,false,off-map,,,,,,\n",
            "",
            "holds 4 frames where run.json counts 5",
        ),
        ("run.json", "{", "", r"run\.json: not JSON"),
        ("run.json", "counts", "count", r"run\.json: not the record of a run"),
        ("run.json", '{"frames": 5}', "5", r"run\.json: not the record of a run"),
        ("run.json", "version", "v", r"run\.json: not the record of a run"),
    ],
)
def test_damaged_folders_are_refused_in_one_line(
    tmp_path: Path, name: str, old: str, new: str, message: str
) -> None:
    with pytest.raises(ResultsError, match=message) as raised:
        load_run(damaged(tmp_path / "out", name, old, new))
    assert "\n" not in str(raised.value)


def test_an_interrupted_run_is_told_from_a_missing_folder(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out")
    (folder / "run.json").unlink()
    with pytest.raises(ResultsError, match=r"no run\.json, so no finished run: run `uasthn geotag"):
        load_run(folder)
    with pytest.raises(ResultsError, match="absent: no such results folder"):
        load_run(tmp_path / "absent")
    with pytest.raises(ResultsError, match="no such results folder"):
        load_run(folder / "frames.csv")


def test_missing_empty_and_binary_tables_are_refused(tmp_path: Path) -> None:
    table = write_folder(tmp_path / "out") / "frames.csv"
    table.write_bytes(b"\xff\xfe\x81")
    with pytest.raises(ResultsError, match="not a CSV table in UTF-8"):
        load_run(tmp_path / "out")
    table.write_bytes(b"")
    with pytest.raises(ResultsError, match=r"column frame, .* is missing"):
        load_run(tmp_path / "out")
    table.unlink()
    with pytest.raises(ResultsError, match="No such file"):
        load_run(tmp_path / "out")
