"""``uasthn geotag`` by each method of uncertainty: ensembles, Direct Modeling, merges."""

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from click.testing import CliRunner, Result
from small_displacement_models import fixed_weights, small_weights
from small_flight import FRAME_GSD_M, FRAME_SIZE_PX, Flight, make_flight

from uasthn_cli.commands.main import main
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_weights import serialise_xcorr
from uasthn_cli.types import FloatArray

PIXEL_M = FRAME_SIZE_PX[0] * FRAME_GSD_M / 256
"""Ground size of a pixel at W_R of the networks of ``fixed_weights``."""

U_COLUMNS = [f"u_{corner}_{axis}_m" for corner in ("tl", "tr", "bl", "br") for axis in "xy"]
IHN = ("--estimator", "ihn", "--calibration", "none")

Run = Callable[..., Path]


def geotag(flight: Flight, out: Path, weights: list[Path], *options: str) -> Result:
    files = [part for path in weights for part in ("--weights", str(path))]
    return CliRunner().invoke(main, flight.arguments(out, *files, *options))


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    """Return a flight of two frames: networks take their time."""
    return make_flight(tmp_path / "flight", count=2)


@pytest.fixture
def run(flight: Flight, tmp_path: Path) -> Run:
    """Return a function that geo-tags and returns a new results folder."""

    def call(weights: list[Path], *options: str) -> Path:
        out = tmp_path / f"out{len(list(tmp_path.iterdir()))}"
        result = geotag(flight, out, weights, *IHN, *options)
        assert result.exit_code == 0, result.stderr
        return out

    return call


def rows(out: Path) -> list[dict[str, str]]:
    with (out / "frames.csv").open(newline="", encoding="utf-8") as handle:
        return list(csv.DictReader(handle))


def deviations_m(out: Path) -> FloatArray:
    """Return the deviations ``(n, 8)`` of all frames' corners."""
    return np.array([[float(row[name]) for name in U_COLUMNS] for row in rows(out)])


def east_m(out: Path) -> FloatArray:
    """Return how far east ``(n,)`` the frames' middles lie, from Greenwich."""
    places = np.array([[float(row["center_lat"]), float(row["center_lon"])] for row in rows(out)])
    metres: FloatArray = 111_320.0 * np.cos(np.radians(places[0, 0])) * places[:, 1]
    return metres


def uncertainty_of(out: Path) -> dict[str, Any]:
    noted: dict[str, Any] = json.loads((out / "run.json").read_text("utf-8"))["notes"]
    said: dict[str, Any] = noted["uncertainty"]
    return said


def test_members_deviate_by_what_lies_between_them(run: Run, tmp_path: Path) -> None:
    here = fixed_weights(tmp_path / "here.safetensors")
    there = fixed_weights(tmp_path / "there.safetensors", shift_px=(12.0, 0.0))
    apart_m = 12.0 * PIXEL_M
    mean = run([here, there], "--crops", "1", "--rule", "any")
    found = deviations_m(mean)
    assert found[:, 0::2] == pytest.approx(apart_m / math.sqrt(2), rel=0.05)
    assert found[:, 1::2] == pytest.approx(0.0, abs=0.01)
    original = run([here, there], "--ue", "de", "--aggregation", "original", "--max-std", "2m")
    assert [row["accepted"] for row in rows(mean)] == ["true"] * 2
    assert east_m(mean) - east_m(original) == pytest.approx(apart_m / 2, rel=0.05)
    strict = run([here, there], "--views", "1", "--rule", "any", "--max-std", "2m")
    assert [row["reason"] for row in rows(strict)] == ["uncertain"] * 2
    assert uncertainty_of(mean) == {
        "method": "de",
        "aggregation": "mean",
        "merge": None,
        "views": 1,
        "members": 2,
    }
    inputs = json.loads((mean / "run.json").read_text("utf-8"))["inputs"]
    assert [Path(inputs[f"weights_{k}"]["path"]) for k in (1, 2)] == [here, there]


@pytest.mark.slow
def test_merges_join_what_crops_and_members_say(run: Run, tmp_path: Path) -> None:
    members = [small_weights(tmp_path, "ihn", seed) for seed in (1, 2)]
    crops = deviations_m(run(members[:1], "--ue", "croptta", "--views", "3"))
    ensemble = deviations_m(run(members, "--ue", "de"))
    assert (np.abs(crops - ensemble) > 0.01).all()
    both = run(members, "--views", "3")
    rounding_m = 0.002
    assert deviations_m(both) == pytest.approx(np.maximum(crops, ensemble), abs=rounding_m)
    least, total = (
        deviations_m(run(members, "--views", "3", "--merge", name)) for name in ("min", "add")
    )
    assert least == pytest.approx(np.minimum(crops, ensemble), abs=rounding_m)
    assert total == pytest.approx(crops + ensemble, abs=rounding_m)
    said = uncertainty_of(both)
    assert (said["method"], said["merge"], said["aggregation"]) == ("croptta+de", "max", "mean")
    assert (said["views"], said["members"]) == (3, 2)
    again = run(members, "--views", "3")
    assert (again / "frames.csv").read_bytes() == (both / "frames.csv").read_bytes()
    assert (again / "frames.geojson").read_bytes() == (both / "frames.geojson").read_bytes()


def test_direct_modeling_is_what_the_network_states(run: Run, tmp_path: Path) -> None:
    stated_px = 4.0
    sure, unsure = (
        fixed_weights(tmp_path / f"{factor}.safetensors", log_variance=2 * math.log(deviation_px))
        for factor, deviation_px in ((1, stated_px), (3, 3 * stated_px))
    )
    found = deviations_m(run([sure], "--ue", "dm"))
    # corners of a frame that is not square lie inside the square that the network speaks of
    assert found == pytest.approx(stated_px * PIXEL_M, rel=0.15)
    tripled = run([unsure], "--crops", "1")
    assert deviations_m(tripled) == pytest.approx(3 * found, abs=0.005)
    assert uncertainty_of(tripled)["method"] == "dm"
    assert [row["accepted"] for row in rows(tripled)] == ["true"] * 2
    limit = f"{2 * stated_px * PIXEL_M:.2f}m"
    strict = [run([path], "--ue", "dm", "--max-std", limit) for path in (sure, unsure)]
    assert [row["accepted"] for row in rows(strict[0])] == ["true"] * 2
    assert [row["reason"] for row in rows(strict[1])] == ["uncertain"] * 2


def test_a_head_does_not_speak_where_crops_do(run: Run, tmp_path: Path) -> None:
    headed = fixed_weights(tmp_path / "headed.safetensors", log_variance=3.0)
    plain = fixed_weights(tmp_path / "plain.safetensors")
    spoken, silent = (deviations_m(run([path], "--views", "2")) for path in (headed, plain))
    assert spoken == pytest.approx(silent, abs=0.002)


def test_networks_without_scores_leave_every_frame_alone(flight: Flight, tmp_path: Path) -> None:
    weights = [fixed_weights(tmp_path / "here.safetensors")]
    outs = [tmp_path / "fused", tmp_path / "alone"]
    fused, alone = (
        geotag(flight, out, weights, *IHN, "--views", "2", option)
        for out, option in zip(outs, ("--fuse", "--no-fuse"), strict=True)
    )
    assert "Every frame stands alone: this estimator scores no places" in fused.stderr
    assert "stands alone" not in alone.stderr
    assert (outs[0] / "frames.csv").read_bytes() == (outs[1] / "frames.csv").read_bytes()
    assert {row["source"] for row in rows(outs[0])} == {"fix"}


@pytest.mark.slow
def test_xcorr_averages_the_networks_given(flight: Flight, tmp_path: Path) -> None:
    files = []
    for seed in (1, 2):
        torch.manual_seed(seed)
        files.append(tmp_path / f"xcorr-{seed}.safetensors")
        model = XcorrModel(XcorrArchitecture(4, (4, 4, 4, 4)))
        files[-1].write_bytes(serialise_xcorr(model, {}))
    found: list[list[str]] = []
    for weights in ([files[0]], files, files[::-1]):
        out = tmp_path / f"out{len(found)}"
        result = geotag(flight, out, weights, "--estimator", "xcorr", "--no-fuse")
        assert result.exit_code == 0, result.stderr
        found.append([row["entropy"] for row in rows(out)])
    assert found[1] == found[2]
    assert found[0] != found[1]
    said = uncertainty_of(tmp_path / "out1")
    assert (said["method"], said["members"]) == ("croptta", 1)


@pytest.mark.parametrize(
    ("options", "files", "exit_code", "why"),
    [
        (["--ue", "dm", "--estimator", "xcorr"], 0, 2, "xcorr has none"),
        (["--ue", "dm", *IHN], 1, 19, "needs a network with a second head; ihn has none"),
        (["--ue", "de", *IHN], 1, 2, "de needs an ensemble"),
        (["--ue", "de", "--estimator", "xcorr", "--ensemble"], 0, 2, "averages the scores"),
        (["--ue", "croptta", *IHN], 2, 2, "asks one network alone"),
        (["--merge", "max", *IHN], 1, 2, "nothing to merge"),
        (["--merge", "max", "--crops", "1", *IHN], 2, 2, "nothing to merge"),
        (["--aggregation", "mean", "--ue-iterations", "1", *IHN], 1, 2, "leaves one view"),
        (["--ue-iterations", "1", "--crops", "1", *IHN], 2, 2, "stops crops early"),
        (["--ue", "none", "--max-std", "5m"], 0, 2, "--max-std limits deviations"),
        (["--ue", "none", "--estimator", "xcorr"], 0, 2, "add --calibration none"),
        (["--ensemble", *IHN], 2, 19, "ihn has no ensemble"),
        (["--estimator", "ncc"], 2, 19, "ncc uses no weights"),
        (["--estimator", "xcorr", "--ensemble"], 2, 19, "leave out --weights"),
    ],
)
def test_contradictions_are_refused(
    flight: Flight, tmp_path: Path, options: list[str], files: int, exit_code: int, why: str
) -> None:
    weights = [small_weights(tmp_path, "ihn", seed) for seed in range(1, files + 1)]
    if exit_code == 2:  # nothing is opened before
        flight.log.unlink()
    result = geotag(flight, tmp_path / "out", weights, *options)
    assert result.exit_code == exit_code, result.stderr
    assert why in result.stderr.replace("\n", " ")
    assert not (tmp_path / "out").exists()


def test_steps_of_dhn_cannot_be_stopped_and_no_file_counts_twice(
    flight: Flight, tmp_path: Path
) -> None:
    dhn = small_weights(tmp_path, "dhn")
    options = ("--estimator", "dhn", "--ue-iterations", "1")
    stopped = geotag(flight, tmp_path / "out", [dhn], *options)
    assert stopped.exit_code == 19
    assert "dhn takes no steps that could be stopped" in stopped.stderr
    twice = geotag(flight, tmp_path / "out", [dhn, dhn], "--estimator", "dhn")
    assert twice.exit_code == 2
    assert "is given twice" in twice.stderr
