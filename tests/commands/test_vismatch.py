"""``--estimator vismatch:NAME`` from the command line to the results folder."""

import csv
import json
import sys
from pathlib import Path

import pytest
import torch
from click.testing import CliRunner
from safetensors.torch import save_file
from small_flight import Flight

from uasthn_cli.commands.main import main
from uasthn_cli.outputs.run_record import file_sha256


@pytest.mark.usefixtures("fake_vismatch")
def test_a_flight_by_a_matcher_with_weights_of_ones_own(flight: Flight, tmp_path: Path) -> None:
    weights, out = tmp_path / "own.safetensors", tmp_path / "out"
    save_file({"model.weight": torch.ones(1, 2), "model.bias": torch.ones(1)}, weights)
    options = ["--estimator", "vismatch:weighted", "--weights", str(weights)]
    arguments = flight.arguments(out, "--truth", str(flight.truth), *options)
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.stderr
    assert "a matcher that talks" not in result.stdout
    with (out / "frames.csv").open(newline="", encoding="utf-8") as handle:
        rows = list(csv.DictReader(handle))
    assert all(row["accepted"] == "true" and float(row["ce_m"]) < 5.0 for row in rows)
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert record["notes"]["estimator"] == "vismatch:weighted"
    assert record["inputs"]["weights"]["sha256"] == file_sha256(weights)


@pytest.mark.usefixtures("fake_vismatch")
def test_weights_that_vismatch_has_are_no_input(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = flight.arguments(out, "--estimator", "vismatch:grid")
    assert CliRunner().invoke(main, arguments).exit_code == 0
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert "weights" not in record["inputs"]


def test_without_the_extra_there_is_one_line_and_a_code(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "vismatch", None)
    out = tmp_path / "out"
    result = CliRunner().invoke(main, flight.arguments(out, "--estimator", "vismatch:xfeat"))
    assert result.exit_code == 26
    assert result.stderr.splitlines()[-1].startswith("uasthn: error: ")
    assert "pip install 'uasthn[vismatch]'" in result.stderr
    assert not out.exists()
