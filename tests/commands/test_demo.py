"""The demo: from nothing to a report, with the weights in the package."""

import csv
from pathlib import Path

import pytest
from click.testing import CliRunner

from uasthn_cli.commands import demo as demo_module
from uasthn_cli.commands.main import main


@pytest.mark.slow
def test_demo_renders_geotags_and_reports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo_module, "_FRAMES", 4)
    out = tmp_path / "demo"
    result = CliRunner().invoke(main, ["demo", "--out", str(out)])
    assert result.exit_code == 0, result.stderr
    assert "within 25 m, accepted" in result.stdout
    assert "of 4 frames accepted" in result.stderr
    with (out / "results" / "frames.csv").open(newline="", encoding="utf-8") as handle:
        rows = list(csv.DictReader(handle))
    assert len(rows) == 4
    assert all(float(row["ce_m"]) <= 25.0 for row in rows if row["accepted"] == "true")

    again = CliRunner().invoke(main, ["demo", "--out", str(out)])
    assert again.exit_code == 18
    assert "--overwrite" in again.stderr
