"""The committed example: small, whole, and what the command line in its README renders."""

import csv
import shlex
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from uasthn_cli.commands.synth import synth
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.synth.exposures import plan_exposures
from uasthn_cli.synth.flight_config import FlightConfig
from uasthn_cli.synth.flight_folder import flight_in

EXAMPLES = Path(__file__).parents[2] / "examples"
FLIGHT = EXAMPLES / "flight"
LARGEST_BYTES = 3_000_000


@pytest.fixture(scope="module")
def truth() -> list[dict[str, str]]:
    with (FLIGHT / "truth.csv").open(newline="") as handle:
        return list(csv.DictReader(handle))


def test_examples_are_small() -> None:
    sizes = [path.stat().st_size for path in EXAMPLES.rglob("*") if path.is_file()]
    assert sum(sizes) < LARGEST_BYTES


def test_frames_and_truth_belong_together(truth: list[dict[str, str]]) -> None:
    assert [row["frame"] for row in truth] == sorted(p.name for p in (FLIGHT / "frames").iterdir())
    with Image.open(FLIGHT / "frames" / truth[0]["frame"]) as frame:
        assert frame.size == (320, 256)


def test_the_log_spans_the_frames(truth: list[dict[str, str]]) -> None:
    stamps = read_telemetry(FLIGHT / "flight.tlog").positions.stamps
    times_s = [float(row["unix_time_s"]) for row in truth]
    assert stamps.record_s[0] < times_s[0]
    assert stamps.record_s[-1] > times_s[-1]


def test_today_it_would_be_rendered_the_same(truth: list[dict[str, str]], tmp_path: Path) -> None:
    readme = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    (line,) = (line for line in readme.splitlines() if line.startswith("    uasthn synth "))
    result = CliRunner().invoke(synth, [str(tmp_path / "flight"), *shlex.split(line)[3:]])
    assert result.exit_code == 0, result.output
    again = flight_in(tmp_path / "flight")
    assert {path.name for path in again.map.parent.iterdir()} == {
        path.name for path in FLIGHT.iterdir()
    }
    with again.truth.open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    assert [list(row) for row in rows] == [list(row) for row in truth]
    for row, before in zip(rows, truth, strict=True):
        for name, cell in row.items():
            if name != "frame":
                assert float(cell) == pytest.approx(float(before[name]), abs=2e-8)
        # libraries differ in the last digits, and gain control with them: grey levels
        with (
            Image.open(again.frames / row["frame"]) as shown,
            Image.open(FLIGHT / "frames" / before["frame"]) as kept,
        ):
            off = np.asarray(shown, dtype=np.float64) - np.asarray(kept)
        assert np.abs(off).mean() < 1.0
    logs = [read_telemetry(folder / "flight.tlog") for folder in (again.map.parent, FLIGHT)]
    for part in ("roll_rad", "pitch_rad", "yaw_rad"):
        new, old = (getattr(log.attitudes, part) for log in logs)
        assert new == pytest.approx(old, abs=1e-6)
    for part in ("lat_deg", "lon_deg", "height_m"):
        new, old = (getattr(log.positions, part) for log in logs)
        assert new == pytest.approx(old, abs=2e-7 if part != "height_m" else 2e-3)


def test_the_readme_says_how_it_was_rendered(truth: list[dict[str, str]]) -> None:
    readme = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    (line,) = (line for line in readme.splitlines() if line.startswith("    uasthn synth "))
    options = synth.make_context("synth", shlex.split(line)[2:]).params
    width_px, height_px = options["frame_size_px"]
    config = FlightConfig(
        seed=options["seed"],
        frames=options["frames"],
        frame_width_px=width_px,
        frame_height_px=height_px,
        hfov_deg=options["hfov_deg"],
        height_m=options["height_m"],
    )
    home = LocalFrame(config.lat_deg, config.lon_deg)
    _, exposures = plan_exposures(config)
    assert [exposure.name for exposure in exposures] == [row["frame"] for row in truth]
    rendered = np.array([(e.pose.east_m, e.pose.north_m) for e in exposures])
    committed = np.array([(float(row["lat"]), float(row["lon"])) for row in truth])
    assert distance_m(home.to_degrees(rendered), committed).max() < 0.01
