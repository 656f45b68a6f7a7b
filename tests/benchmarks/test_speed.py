"""Speed is that of whole processes, counted against an older version on the same flight."""

import csv
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from processes import Usage
from small_flight import HFOV_DEG, make_flight
from speed import main
from speed_cases import Case, Tool
from speed_figures import OUTSIDE, Figures, Sample
from speed_tables import as_csv, as_markdown

TOOL = Tool(("uasthn",), {})


def figures_of(group: str, whole_s: list[float], one_s: float) -> Figures:
    case = Case(group, group, "flight", TOOL, count=11, geotags=True)
    stages = {"search": 0.11, OUTSIDE: 0.0, "other": -1.0}
    whole = [Sample(Usage(cpu_s, 2.0 * cpu_s, 100.0), stages, "0.1") for cpu_s in whole_s]
    return Figures(case, whole, [Sample(Usage(one_s, 2.0 * one_s, 50.0), stages, "0.1")])


def cells_of(text: str, name: str) -> list[str]:
    line = next(line for line in text.splitlines() if line.startswith(f"| {name} "))
    return [cell.strip() for cell in line.split("|")[2:-1]]


def test_the_smallest_time_counts_and_start_up_is_told_apart() -> None:
    found = [figures_of("before", [23.0, 22.0, 24.0], 2.0), figures_of("after", [3.2, 2.2], 0.2)]
    text = as_markdown(found, threads=3)
    assert cells_of(text, "before") == [
        *("22.00", "23.00", "44.00", "46.00"),
        *("2000.0", "4000.0", "2000.0", "4000.0", "100", "1.0", "1.0"),
    ]
    assert cells_of(text, "after")[4:] == [
        "200.0",
        "400.0",
        "200.0",
        "400.0",
        "100",
        "10.0",
        "10.0",
    ]
    assert cells_of(text, "search") == ["10.0", "10.0"]
    assert cells_of(text, "other") == ["–", "–"], "threads ran at the same time"
    assert "before: 0.1; after: " in text
    assert "3 threads" in text.splitlines()[-1]
    rows = list(csv.DictReader(as_csv(found).splitlines()))
    assert [float(row["times_before"]) for row in rows] == [1.0, 10.0]
    assert rows[1]["log_s"] == ""


def test_what_failed_says_why() -> None:
    broken = Figures(Case("jobs", "two jobs", "flight", TOOL), error="exit code 2: no --jobs")
    text = as_markdown([broken], threads=1)
    assert "Left out: flight, two jobs: exit code 2: no --jobs" in text
    assert as_csv([broken]).strip() == ""


def test_settings_go_with_flights(tmp_path: Path) -> None:
    arguments = [str(tmp_path)] * 3 + ["--hfov", "45", "--search-radius", "1"]
    result = CliRunner().invoke(main, [*arguments, "--search-radius", "2"])
    assert result.exit_code == 2
    assert "give --search-radius once, or once for each flight" in result.output
    result = CliRunner().invoke(main, [*arguments, "--reach", "100,x"])
    assert "100,x: give numbers above 0" in result.output


@pytest.mark.slow
def test_a_flight_is_measured_from_start_to_end(tmp_path: Path) -> None:
    flight = make_flight(tmp_path / "small", count=2)
    groups = ("floor", "before", "after", "start")
    asked = [part for group in groups for part in ("--only", group)]
    settings = ["--hfov", str(HFOV_DEG), "--search-radius", "40", "--repeat", "1"]
    settings += [
        "--geotag",
        "--estimator ncc --no-fuse",
        "--before",
        f"{sys.executable} -m uasthn_cli",
    ]
    settings += ["--before-path", str(Path(__file__).parents[2])]
    out = tmp_path / "out"
    arguments = [str(flight.log.parent), *settings, *asked, "--out", str(out)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    with (out / "speed.csv").open(newline="", encoding="utf-8") as handle:
        rows = {row["run"]: row for row in csv.DictReader(handle)}
    assert {row["group"] for row in rows.values()} == set(groups)
    for row in rows.values():
        assert 0.0 < float(row["cpu_min_s"]) <= float(row["cpu_median_s"])
        assert float(row["peak_mib"]) > 5.0
    assert float(rows["before"]["times_before"]) == 1.0
    assert float(rows["no cache"]["search_s"]) > 0.0
    assert float(rows["no cache"][f"{OUTSIDE}_s"]) > 0.0
    table = (out / "speed.md").read_text("utf-8")
    assert result.stdout == table
    assert "after: first frame, kept features" in table
