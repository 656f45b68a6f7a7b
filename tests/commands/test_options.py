"""Shared options: what the command receives for what was typed."""

import csv
import json
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner
from small_flight import Flight

from uasthn_cli.commands.main import COMMANDS, main
from uasthn_cli.commands.matching_options import matching_options
from uasthn_cli.commands.options import camera_options, prior_options
from uasthn_cli.config import (
    Aggregation,
    GeotagConfig,
    PairBy,
    PriorConfig,
    Rule,
    Sampling,
    TimeBase,
)
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.matching import registry


@pytest.fixture
def received() -> dict[str, Any]:
    """Return what the probe command was called with."""
    return {}


@pytest.fixture
def probe(received: dict[str, Any]) -> click.Command:
    """Return a command with all shared options."""

    @click.command()
    @camera_options
    @prior_options
    @matching_options
    def probe(camera: CameraSpec, prior: PriorConfig, config: GeotagConfig) -> None:
        received.update(camera=camera, prior=prior, config=config)

    return probe


def test_defaults_are_those_of_the_configuration(
    probe: click.Command, received: dict[str, Any]
) -> None:
    assert CliRunner().invoke(probe, []).exit_code == 0
    assert received == {"camera": CameraSpec(), "prior": PriorConfig(), "config": GeotagConfig()}


def test_every_option_arrives(probe: click.Command, received: dict[str, Any]) -> None:
    typed = (
        "--focal-mm 13 --pixel-pitch-um 17 --distortion=-0.3,0.1,0,0 --mount-yaw -90"
        " --time-base record --pair-by time --time-offset -2.5 --max-gap 0.5 --height-m 120"
        " --search-radius 450 --gsd 1.5 --estimator ncc --device cpu --crops 9"
        " --crop-sampling grid --crop-offset 0.25 --seed 3 --aggregation mean --max-std 4px"
        " --rule any --min-confidence 0.7"
    )
    result = CliRunner().invoke(probe, typed.split())
    assert result.exit_code == 0, result.stderr
    assert received["camera"] == CameraSpec(
        focal_mm=13.0, pixel_pitch_um=17.0, distortion=(-0.3, 0.1, 0.0, 0.0), mount_yaw_deg=-90.0
    )
    assert received["prior"] == PriorConfig(TimeBase.RECORD, -2.5, 0.5, 120.0, PairBy.TIME)
    config: GeotagConfig = received["config"]
    assert (config.search_radius_m, config.gsd_m) == (450.0, 1.5)
    assert (config.estimator, config.device) == ("ncc", "cpu")
    assert config.aggregation is Aggregation.MEAN
    crops = config.crops
    assert (crops.views, crops.sampling) == (9, Sampling.GRID)
    assert (crops.offset_fraction, crops.seed) == (0.25, 3)
    decision = config.decision
    assert (decision.max_std_px, decision.rule) == (4.0, Rule.ANY)
    assert decision.min_confidence == 0.7


def test_threshold_in_metres_leaves_no_threshold_in_pixels(
    probe: click.Command, received: dict[str, Any]
) -> None:
    assert CliRunner().invoke(probe, ["--max-std", "7.5m"]).exit_code == 0
    decision = received["config"].decision
    assert (decision.max_std_m, decision.max_std_px) == (7.5, None)


@pytest.mark.parametrize(
    "typed",
    [
        "--hfov 180",
        "--hfov 0",
        "--search-radius 0",
        "--search-radius nan",
        "--max-gap -1",
        "--crops 0",
        "--crop-offset 0.5",
        "--min-confidence 1.1",
        "--time-base gps",
        "--estimator sift",
        "--max-std 10",
        "--time-offset soon",
    ],
)
def test_nonsense_is_a_usage_error(probe: click.Command, typed: str) -> None:
    result = CliRunner().invoke(probe, typed.split())
    assert result.exit_code == 2
    assert typed.split(maxsplit=1)[0] in result.stderr


@pytest.mark.parametrize("command", ["geotag", "evaluate"])
def test_estimators_offered_are_those_there_are(command: str) -> None:
    text = CliRunner().invoke(main, [command, "--help"], terminal_width=100).stdout
    assert "|".join(registry.estimator_names()) in text


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - {"completion"}))
def test_help_ends_lines_in_time(name: str) -> None:
    result = CliRunner().invoke(main, [name, "--help"], terminal_width=80)
    assert max(map(len, result.stdout.splitlines())) <= 100


def test_geotag_help_has_sections_and_worked_examples() -> None:
    text = CliRunner().invoke(main, ["geotag", "--help"]).stdout
    headings = ["Input:", "Output:", "Camera", "Time and height:", "Search:", "Trust:", "Other:"]
    places = [text.index(f"\n{heading}") for heading in headings]
    assert places == sorted(places)
    assert text.index("--time-offset 2.5 --out") > places[-1]


def test_cameras_are_listed_with_their_sources() -> None:
    table = CliRunner().invoke(main, ["cameras"])
    listed = json.loads(CliRunner().invoke(main, ["cameras", "--json"]).stdout)
    assert table.exit_code == 0
    assert len(table.stdout.splitlines()) == 1 + len(listed)
    boson = next(camera for camera in listed if camera["name"] == "boson640-18mm")
    assert boson["hfov_deg"] == 24.1
    assert all(camera["source"] for camera in listed)


def test_positions_in_the_maps_own_crs(flight: Flight, tmp_path: Path) -> None:
    tables = {}
    for crs in ("map", "EPSG:32640", "EPSG:4326"):
        out = tmp_path / crs.replace(":", "")
        assert CliRunner().invoke(main, flight.arguments(out, "--crs", crs)).exit_code == 0
        with (out / "frames.csv").open(newline="", encoding="utf-8") as handle:
            tables[crs] = list(csv.DictReader(handle))
    for own, same, degrees in zip(*tables.values(), strict=True):
        assert (own["x"], own["center_y"]) == (same["x"], same["center_y"])
        assert (degrees["x"], degrees["y"]) == (degrees["lon"], degrees["lat"])
        assert 499_000 < float(own["x"]) < 501_000
