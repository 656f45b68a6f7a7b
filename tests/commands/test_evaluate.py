import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from known_estimator import made_up_predictions
from pair_sources import write_boson
from small_displacement_models import small_weights
from small_flight import HFOV_DEG, make_flight

from uasthn_cli.commands.evaluate import evaluate
from uasthn_cli.errors import DatasetError, OutputError, PredictionsError, WeightsError
from uasthn_cli.evaluation.predictions import load_predictions, save_predictions

NCC = ("--estimator", "ncc", "--hfov", HFOV_DEG)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(evaluate, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_flight(tmp_path_factory.mktemp("data") / "flight", 3).map.parent


def test_a_flight_end_to_end(flight: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run(flight, *NCC, "--dc", 15, "--dc", 30, "--out", out)
    assert result.exit_code == 0, result.output
    assert {path.name for path in out.iterdir()} == {
        *("ncc-dc15.npz", "ncc-dc30.npz", "accuracy.csv", "timing.csv", "evaluation.json"),
        *(f"{name}.{kind}" for name in ("accepted-mace", "mace-histogram") for kind in PICTURES),
    }
    with (out / "accuracy.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [(row["ue"], row["max_offset_m"]) for row in rows] == [
        *(("none", "15.0"), ("croptta", "15.0"), ("none", "30.0"), ("croptta", "30.0")),
    ]
    # frames are negatives of the map: NCC finds every one of them
    assert all(float(row["mace_all_m"]) < 5.0 for row in rows)
    assert "of these ≤ 25 m" in result.stdout
    assert "\x1b" not in result.stdout
    assert "CropTTA ms" in result.stdout


PICTURES = ("png", "svg")


def test_predictions_are_made_once_and_drawn_again(flight: Path, tmp_path: Path) -> None:
    out, again = tmp_path / "out", tmp_path / "again"
    command = (flight, *NCC, "--dc", 15, "--views", 3, "--no-figures", "--out", out)
    assert run(*command).exit_code == 0
    made = (out / "ncc-dc15.npz").read_bytes()
    assert run(*command).exit_code == 0
    assert (out / "ncc-dc15.npz").read_bytes() == made
    drawn = run("--from", out / "ncc-dc15.npz", "--max-std", "4px", "--out", again)
    assert drawn.exit_code == 0, drawn.output
    assert not list(again.glob("*.npz"))
    assert json.loads((again / "evaluation.json").read_text())["runs"][0]["views"] == 3
    for changed in (("--seed", 4), ("--samples", 2), ("--wt", 40)):
        other = run(*command[:-2], *changed, "--out", out)
        assert isinstance(other.exception, OutputError)
    assert run(*command[:-2], "--seed", 4, "--out", out, "--overwrite").exit_code == 0
    assert load_predictions(out / "ncc-dc15.npz").settings.seed == 4


def test_a_miniature_of_boson_nighttime(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, {"val": [(1000, 800), (1400, 900)]})
    out = tmp_path / "out"
    result = run(folder, *NCC[:2], "--split", "val", "--ws", 900, "--dc", 128, "--out", out)
    assert result.exit_code == 0, result.output
    (none, _) = json.loads((out / "evaluation.json").read_text())["accuracy"]
    assert none["mace_all_m"] < 3.0
    assert load_predictions(out / "ncc-dc128.npz").settings.split == "val"


def test_a_dhn_that_models_its_deviations(flight: Path, tmp_path: Path) -> None:
    out, weights = tmp_path / "out", small_weights(tmp_path, "dhn+dm")
    network = (*("--estimator", "dhn", "--weights", weights), *("--hfov", HFOV_DEG))
    result = run(flight, *network, "--dc", 15, "--no-figures", "--out", out)
    assert result.exit_code == 0, result.output
    rows = json.loads((out / "evaluation.json").read_text())["accuracy"]
    assert [row["ue"] for row in rows] == ["none", "dm", "croptta"]
    assert np.isfinite(load_predictions(out / "dhn-dc15.npz").modelled_std_px).all()


def test_thresholds_and_merges_are_of_the_drawing(tmp_path: Path) -> None:
    errors_m, std_m = np.array([1.0, 2.0, 60.0]), np.array([1.0, 7.0, 9.0])
    path = tmp_path / "a.npz"
    save_predictions(path, made_up_predictions(errors_m, std_m, members=3))

    def accepted(*options: str) -> float:
        out = tmp_path / "out"
        result = run("--from", path, "--ue", "croptta+de", *options, "--no-figures", "--out", out)
        assert result.exit_code == 0, result.output
        (row,) = json.loads((out / "evaluation.json").read_text())["accuracy"]
        return float(row["accepted_fraction"])

    # the ensemble deviates by twice as much as the crops
    assert accepted("--merge", "min") == 1.0
    assert accepted("--merge", "max") == pytest.approx(1 / 3)
    assert accepted("--merge", "add", "--max-std", "2.5m") == 0.0
    assert accepted("--max-std", "15m") == pytest.approx(2 / 3)


def test_what_makes_no_sense_is_refused(flight: Path, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "out")
    assert "give one DATASET" in run(*out).output
    assert "give one DATASET" in run(flight, flight, *out).output
    assert "--from needs predictions" in run("--from", *out).output
    assert "--from needs predictions" in run("--from", "--stress", flight, *out).output
    assert "'tta' is none of none, dm" in run(flight, "--ue", "none,tta", *out).output
    assert "one method that can reject" in run("--stress", flight, "--ue", "none", *out).output
    assert "takes one --dc" in run("--stress", flight, "--dc", 1, "--dc", 2, *out).output
    save_predictions(tmp_path / "a.npz", made_up_predictions(np.ones(2), np.ones(2)))
    for option in (("--dc", 5), ("--views", 9), ("--estimator", "ncc"), ("--ensemble",)):
        drawn = run("--from", tmp_path / "a.npz", *option, *out)
        assert drawn.exit_code == 2
        assert f"{option[0]} shapes predictions" in drawn.output
    asked = run("--from", tmp_path / "a.npz", "--ue", "de", *out)
    assert isinstance(asked.exception, PredictionsError)
    assert "de needs an ensemble" in str(asked.exception)
    assert isinstance(run(tmp_path / "none", *out).exception, DatasetError)
    ensemble = run(flight, *NCC, "--ensemble", *out)
    assert isinstance(ensemble.exception, WeightsError)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_stress_writes_what_was_rejected(flight: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ("--stress", flight, *NCC, "--dc", 15, "--samples", 1, "--out", out)
    result = run(*command)
    assert result.exit_code == 0, result.output
    rows = json.loads((out / "stress.json").read_text())
    assert len(rows) == 1 + 6 * 3
    assert {row["flight"] for row in rows} == {"flight"}
    assert "self-similar" in result.stdout
    with (out / "stress.csv").open() as handle:
        assert len(list(csv.DictReader(handle))) == len(rows)
    assert isinstance(run(*command).exception, OutputError)
