"""An estimator of another package from the command line: used by name, or refused in one line."""

import json
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from plugin_packages import pretend_installed
from small_flight import HFOV_DEG, Flight

from uasthn_cli.commands.main import main

SOURCE = """
from dataclasses import replace
from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.matching.registry import XCORR

class Theirs(NccEstimator):
    def __init__(self):
        super().__init__()
        self.name = "theirs"

SPEC = replace(XCORR, name="theirs", open=lambda _: Theirs())
"""


@pytest.fixture(autouse=True)
def _forget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "my_package", raising=False)


def test_its_code_is_recorded_and_plain_limits_judge_it(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even where its specification names the calibration in the box."""
    pretend_installed(
        tmp_path / "site", monkeypatch, "my-package", "theirs = my_package:SPEC", SOURCE
    )
    out = tmp_path / "out"
    result = CliRunner().invoke(main, flight.arguments(out, "--estimator", "theirs", "--no-fuse"))
    assert result.exit_code == 0, result.stderr
    assert "judged by plain limits" in result.stderr
    record = json.loads((out / "run.json").read_text("utf-8"))
    assert record["calibration"] is None
    assert record["notes"]["estimator"] == "theirs"
    assert record["inputs"]["estimator"]["package"].startswith("my-package 0.1+src.")


@pytest.mark.parametrize("name", ["theirs", "ncc"])
@pytest.mark.parametrize("command", ["geotag", "evaluate"])
def test_a_broken_package_or_a_name_taken_ends_in_one_line(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, name: str
) -> None:
    point, out = f"{name} = my_package:SPEC", tmp_path / "out"
    pretend_installed(tmp_path / "site", monkeypatch, "my-package", point, "1 / 0")
    arguments = flight.arguments(out, "--estimator", name)
    if command == "evaluate":
        folder = str(flight.map.parent)
        arguments = ["evaluate", folder, "--hfov", str(HFOV_DEG), "--out", str(out)]
        arguments += ["--estimator", name]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 29
    (line,) = result.stderr.splitlines()
    assert line.startswith("uasthn: error: ")
    assert "my-package 0.1" in line
    assert not out.exists()
