"""The stress benchmark: counts what a user would get, and says how sure the counts are."""

import csv
from collections import Counter
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from small_flight import Flight, make_flight
from stress import main
from stress_outcomes import Entry, Outcome, as_csv, as_markdown, measure

from uasthn_cli.synth.flight import render_flight
from uasthn_cli.synth.flight_config import FlightConfig, StressConfig
from uasthn_cli.synth.kinds import LandscapeKind, StressCategory
from uasthn_cli.synth.stress import stress_flight

NCC = "--hfov 45 --estimator ncc --search-radius 40"


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return make_flight(tmp_path_factory.mktemp("flights") / "small", count=3)


def run(flight: Flight, out: Path, *options: str) -> Result:
    arguments = [str(flight.log.parent), "--geotag", NCC, "--out", str(out), *options]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    return result


def test_a_row_per_category_and_severity(flight: Flight, tmp_path: Path) -> None:
    chosen = ["--category", "textureless", "--category", "geometry", "--severity", "1"]
    result = run(flight, tmp_path, *chosen, "--wrong-place", "3")
    with (tmp_path / "stress.csv").open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    categories = ["healthy", "textureless", "geometry", "wrong-place"]
    assert [row["category"] for row in rows] == categories
    assert {row["frames"] for row in rows} == {"3"}
    assert rows[0]["accepted"] == rows[0]["accepted_within_25m"] == "3"
    assert result.stdout == (tmp_path / "stress.md").read_text(encoding="utf-8")
    assert "| all " in result.stdout


def test_beyond_the_map_only_cut_frames_count(flight: Flight, tmp_path: Path) -> None:
    config = StressConfig(StressCategory.BEYOND_MAP, 0.2, seed=3)
    stress_flight(flight.log.parent, tmp_path / "cut", config)
    text = (tmp_path / "cut" / "truth.csv").read_text()
    cut = sum(not line.endswith(",1.0000") for line in text.splitlines()[1:])
    assert 0 < cut < 3
    assert measure(tmp_path / "cut", NCC.split()).frames == cut


def test_a_map_out_of_reach_rejects_every_frame(flight: Flight, tmp_path: Path) -> None:
    config = StressConfig(StressCategory.BEYOND_MAP, 1.0, seed=3)
    stress_flight(flight.log.parent, tmp_path / "cut", config)
    outcome = measure(tmp_path / "cut", [*NCC.split(), "--search-radius", "0.1"])
    assert (outcome.frames, outcome.accepted) == (3, 0)
    assert set(outcome.reasons) <= {"map-elsewhere", "off-map"}


def test_the_bound_is_the_one_that_a_binomial_test_gives() -> None:
    # 1 - 0.05 ** (1 / n): the largest share that shows nothing in n trials one time in twenty
    assert Outcome(1000, 0).upper_bound() == pytest.approx(1.0 - 0.05 ** (1.0 / 1000.0))
    assert Outcome(3000, 0).upper_bound() < 0.001 < Outcome(2990, 0).upper_bound()
    assert Outcome(5, 5).upper_bound() == 1.0


def test_seeds_are_added_up() -> None:
    outcomes = [Outcome(10, 4, 3, Counter({"uncertain": 6})), Outcome(10, 0, 0, Counter("a" * 10))]
    entries = [Entry("f", "geometry", 0.5, seed, each) for seed, each in enumerate(outcomes)]
    row = as_markdown(entries, 1).splitlines()[2]
    cells = [cell.strip() for cell in row.split("|")[1:-1]]
    assert cells == [
        "geometry",
        "0.5",
        "f",
        "20",
        "0.20",
        "0.80",
        "0.75",
        "0.05",
        "10 a, 6 uncertain",
    ]
    assert len(as_csv(entries).splitlines()) == 3


@pytest.mark.slow
def test_the_weights_in_the_box_know_that_they_do_not_know(tmp_path: Path) -> None:
    config = FlightConfig(seed=1, kind=LandscapeKind.FARMS, frames=8)
    render_flight(tmp_path / "healthy", config)
    options = ["--hfov", "45"]
    healthy = measure(tmp_path / "healthy", options)
    assert healthy.found >= 6
    for category in (StressCategory.TEXTURELESS, StressCategory.WRONG_PLACE):
        stress_flight(tmp_path / "healthy", tmp_path / category, StressConfig(category, 1.0))
        assert measure(tmp_path / category, options).accepted <= 2
