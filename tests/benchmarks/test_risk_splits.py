"""Promised against empirical risk over random splits."""

import csv
from pathlib import Path

import pytest
from answer_tables import make_answers, write_results
from click.testing import CliRunner
from risk_splits import main


@pytest.fixture
def folders(tmp_path: Path) -> list[str]:
    return [
        str(
            write_results(
                tmp_path / f"flight{k}",
                make_answers(300, k, wrong=0.02, agreement=True),
                make_answers(300, 10 + k, wrong=0.05),
            )
        )
        for k in range(4)
    ]


@pytest.mark.parametrize("options", [[], ["--by-flight"]])
def test_promises_are_kept_on_frames_that_are_alike(
    folders: list[str], tmp_path: Path, options: list[str]
) -> None:
    out = tmp_path / "out"
    result = CliRunner().invoke(main, [*folders, "--splits", "20", "--out", str(out), *options])
    assert result.exit_code == 0, result.output
    with (out / "risk_splits.csv").open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    assert [row["answers"] for row in rows] == ["single"] * 20 + ["fused"] * 20
    fused = [row for row in rows if row["answers"] == "fused" and row["certified"] == "True"]
    assert len(fused) > 15
    assert sum(float(row["risk"]) for row in fused) / len(fused) < 0.05
    coverage = sum(float(row["ce90_coverage"]) for row in fused) / len(fused)
    assert coverage == pytest.approx(0.9, abs=0.03)
    assert all(int(r["calibration_frames"]) == int(r["test_frames"]) == 600 for r in rows)
    assert "| fused " in (out / "risk_splits.md").read_text("utf-8")
    assert "| fused " in result.stdout


def test_splits_differ_and_come_again(folders: list[str], tmp_path: Path) -> None:
    tables = []
    for name in ("a", "b"):
        arguments = [*folders, "--splits", "5", "--out", str(tmp_path / name)]
        assert CliRunner().invoke(main, arguments).exit_code == 0
        tables.append((tmp_path / name / "risk_splits.csv").read_text())
    assert tables[0] == tables[1]
    risks = [line.split(",")[6] for line in tables[0].splitlines()[1:6]]
    assert len(set(risks)) > 1


def test_by_flight_needs_flights(folders: list[str]) -> None:
    result = CliRunner().invoke(main, [folders[0], "--by-flight"])
    assert result.exit_code == 2
    assert "at least two" in result.output
