"""``uasthn train --network dhn|ihn|sthn`` from the command line."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from pair_sources import texture, write_boson, write_geotiff
from small_displacement_models import small_weights

from uasthn_cli.commands.train import train
from uasthn_cli.errors import DatasetError
from uasthn_cli.matching.displacement.checkpoints import load_displacement

QUICK: tuple[object, ...] = (
    *("--steps", 2, "--batch", 1, "--croptta", 2, "--plain-steps", 1),
    *("--workers", 0, "--checkpoint-every", 1, "--precision", "float32"),
)
SMALL: tuple[object, ...] = ("--ws", 600, "--wt", 200, "--dc", 128)


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uasthn_cli.training.displacement.trainee.keep_freed_memory", lambda: None)
    monkeypatch.setattr("uasthn_cli.training.displacement.batches._VALIDATION_SAMPLES", 2)


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(train, [str(argument) for argument in arguments])


def test_a_map_becomes_weights_that_say_where_they_come_from(tmp_path: Path) -> None:
    chart = write_geotiff(tmp_path / "map.tif", texture(1, 500, 420), 2.5)
    out = tmp_path / "dhn.safetensors"
    begun = small_weights(tmp_path, "dhn").rename(tmp_path / "begun.safetensors")
    result = invoke(
        chart, "--network", "dhn", *QUICK, *SMALL, "--init", begun, "--seed", 3, "--out", out
    )
    assert result.exit_code == 0, result.output
    lines = result.stderr.splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == ["step 1 of 2", "step 2 of 2"]
    assert "validation: median error" in lines[1]
    assert load_displacement(out).notes["seed"] == "3"
    card = out.with_suffix(".md").read_text("utf-8")
    assert f"Pairs of `{chart}`." in card
    (command,) = [line for line in card.splitlines() if line.startswith("uasthn train ")]
    assert "--network dhn --steps 2 --seed 3 " in command
    assert f" --init {begun} " in command
    assert f" {chart} --ws 600.0" in command
    assert "CropTTA loss from step 1 on, 2 views, offset 32 of 512 px" in card


def test_boson_nighttime_is_judged_by_its_own_validation_part(tmp_path: Path) -> None:
    places: dict[str, Sequence[tuple[int, int]]] = {
        "train": [(900, 800), (1400, 850)],
        "val": [(1200, 820)],
    }
    folder, _ = write_boson(tmp_path, places)
    out = tmp_path / "dhn.safetensors"
    begun = small_weights(tmp_path, "dhn").rename(tmp_path / "begun.safetensors")
    result = invoke(folder, "--network", "dhn", *QUICK, "--init", begun, "--out", out)
    assert result.exit_code == 0, result.output
    assert "validation: median error" in result.stderr
    assert load_displacement(out).name == "dhn"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--network", "ihn"), "ihn learns from pairs: give a DATASET"),
        (("d", "--network", "ihn", "--images", "a"), "--images is for --network xcorr, not for"),
        (("d", "--network", "dhn", "--windows", 2), "--windows is for --network xcorr"),
        (("d", "--network", "dhn", "--dm", "--croptta", 5), "choose one"),
        (("d", "--network", "ihn", "--dm", "--croptta", 5), "choose one"),
        (("d", "--network", "ihn", "--preset", "paper-sthn"), "is for --network sthn"),
        (("d", "--network", "ihn", "--first-stage", "frozen", "--init", "x"), "nothing to freeze"),
        (("d", "--network", "sthn", "--first-stage", "frozen"), "give --init"),
        (("d", "--network", "ihn", "--croptta", 1, "--plain-steps", 3), "and there are none"),
        (("d", "--network", "ihn", "--steps", 5, "--plain-steps", 5), "leaves no step"),
        (("d",), "xcorr learns from --images"),
        (("--sand-share", 1, "--dm"), "--dm is for --network dhn, ihn or sthn"),
        (("--sand-share", 1, "--preset", "laptop"), "--preset is for --network"),
        (("--sand-share", 1, "--hfov", 45), "--hfov is for --network"),
        (("--network", "ncc"), "--network"),
    ],
)
def test_requests_that_make_no_sense_are_refused(
    arguments: tuple[object, ...], words: str, tmp_path: Path
) -> None:
    result = invoke(*arguments, "--out", tmp_path / "my.safetensors")
    assert result.exit_code == 2, result.output
    assert words in " ".join(result.stderr.split())
    assert list(tmp_path.iterdir()) == []


def test_a_source_that_is_not_there_is_named(tmp_path: Path) -> None:
    result = invoke(tmp_path / "none", "--network", "ihn", "--out", tmp_path / "my.safetensors")
    assert isinstance(result.exception, DatasetError)
    assert "there is no such file or folder" in str(result.exception)
