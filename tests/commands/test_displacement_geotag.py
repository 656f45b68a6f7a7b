"""``uasthn geotag`` with a network of the paper's: its crops, and its early stopping."""

import csv
from pathlib import Path

import pytest
from click.testing import CliRunner
from small_displacement_models import small_weights
from small_flight import Flight

from uasthn_cli.commands.main import main


def spreads(out: Path) -> list[str]:
    with (out / "frames.csv").open(encoding="utf-8") as handle:
        return [row["u_m"] for row in csv.DictReader(handle)]


def test_early_stopping_changes_how_views_spread(flight: Flight, tmp_path: Path) -> None:
    network = ["--estimator", "ihn", "--weights", str(small_weights(tmp_path, "ihn"))]
    found = []
    for name, options in (("all", []), ("one", ["--ue-iterations", "1"])):
        arguments = flight.arguments(tmp_path / name, "--calibration", "none", *network, *options)
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == 0, result.stderr
        found.append(spreads(tmp_path / name))
    assert found[0] != found[1]
    assert all(float(value) >= 0.0 for value in found[1])


@pytest.mark.parametrize(
    ("estimator", "steps", "why"),
    [
        ("ncc", "1", "takes no steps that could be stopped early"),
        ("ihn", "3", "early stopping after 3 steps: ihn with these weights takes 2"),
    ],
)
def test_steps_that_are_not_taken_cannot_be_stopped(
    flight: Flight, tmp_path: Path, estimator: str, steps: str, why: str
) -> None:
    weights = ["--weights", str(small_weights(tmp_path, "ihn"))] if estimator == "ihn" else []
    options = ["--estimator", estimator, *weights, "--ue-iterations", steps]
    result = CliRunner().invoke(main, flight.arguments(tmp_path / "out", *options))
    assert result.exit_code == 19
    assert why in result.stderr
