"""The comparison of estimators on a flight whose truth is known."""

import csv
from pathlib import Path

import estimators
import pytest
from click.testing import CliRunner
from estimators import main
from small_flight import DRIFT_M, HFOV_DEG, Flight, make_flight


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return make_flight(tmp_path_factory.mktemp("flights") / "small", count=3)


def test_a_row_per_estimator(flight: Flight, tmp_path: Path) -> None:
    names = ("prior", "sift-magsac", "ncc")
    chosen = [option for name in names for option in ("--estimator", name)]
    options = ["--hfov", str(HFOV_DEG), "--search-radius", "40", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(main, [str(flight.log.parent), *options, *chosen])
    assert result.exit_code == 0, result.output
    with (tmp_path / "out" / "estimators.csv").open(newline="") as handle:
        rows = {row["estimator"]: row for row in csv.DictReader(handle)}
    assert tuple(rows) == names
    assert float(rows["prior"]["ce_median_m"]) == pytest.approx(DRIFT_M, abs=0.2)
    assert float(rows["ncc"]["ce_p90_m"]) < 1.0
    assert float(rows["ncc"]["accepted"]) == float(rows["ncc"]["accepted_within_25m"]) == 1.0
    assert float(rows["sift-magsac"]["ce_median_m"]) < 2.0
    assert "| ncc " in (tmp_path / "out" / "estimators.md").read_text("utf-8")


def test_radii_go_with_flights(flight: Flight, tmp_path: Path) -> None:
    folder = str(flight.log.parent)
    options = ["--hfov", "45", "--search-radius", "40", "--search-radius", "50"]
    result = CliRunner().invoke(main, [folder, folder, folder, *options])
    assert result.exit_code == 2
    assert "once for each flight" in result.output


def test_akaze_is_left_out_where_opencv_has_none(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "has_akaze", lambda: False)
    out = tmp_path / "out"
    options = ["--hfov", str(HFOV_DEG), "--search-radius", "40", "--out", str(out)]
    names = ["--estimator", "prior", "--estimator", "akaze-magsac"]
    result = CliRunner().invoke(main, [str(flight.log.parent), *options, *names])
    assert result.exit_code == 0, result.output
    assert "akaze-magsac: left out" in result.stderr
    assert "akaze" not in result.stdout
