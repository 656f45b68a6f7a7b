"""``--tgm``: thermal images from a generator, to learn from and to judge by."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from click import Command
from click.testing import CliRunner, Result
from pair_sources import texture, write_boson, write_geotiff
from small_displacement_models import small_weights
from small_flight import HFOV_DEG, make_flight
from tiny_tgm import write_tiny_generator

from uasthn_cli.commands.evaluate import evaluate
from uasthn_cli.commands.train import train
from uasthn_cli.errors import OutputError
from uasthn_cli.evaluation.predictions import load_predictions

SMALL: tuple[object, ...] = ("--ws", 600, "--wt", 200, "--dc", 128)
TRAINING: tuple[object, ...] = (
    *("--network", "dhn", "--steps", 1, "--batch", 1, "--croptta", 1, "--precision", "float32"),
    *("--checkpoint-every", 1),
)


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uasthn_cli.training.displacement.trainee.keep_freed_memory", lambda: None)
    monkeypatch.setattr("uasthn_cli.training.displacement.batches._VALIDATION_SAMPLES", 2)


def run(command: Command, *arguments: object) -> Result:
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


@pytest.fixture
def chart(tmp_path: Path) -> Path:
    return write_geotiff(tmp_path / "map.tif", texture(1, 500, 420), 2.5)


@pytest.fixture
def generator(tmp_path: Path) -> Path:
    return write_tiny_generator(tmp_path / "tgm.safetensors", gsd_m=2.5)


def learn(source: Path, generator: Path, folder: Path, *options: object) -> tuple[bytes, str]:
    """Return weights and model card."""
    folder.mkdir()
    begun = small_weights(folder, "dhn")
    out = folder / "learnt.safetensors"
    result = run(
        train,
        *(source, *TRAINING, *SMALL, "--tgm", generator, *options),
        *("--init", begun, "--out", out),
    )
    assert result.exit_code == 0, result.output
    assert "validation: median error" in result.stderr
    return out.read_bytes(), out.with_suffix(".md").read_text("utf-8")


@pytest.mark.parametrize("workers", [0, 2])
def test_overhead_images_are_all_drawn(
    workers: int, chart: Path, generator: Path, tmp_path: Path
) -> None:
    weights, card = learn(chart, generator, tmp_path / "a", "--workers", workers)
    assert "The thermal images of 100% were drawn" in card
    assert hashlib.sha256(generator.read_bytes()).hexdigest() in card
    assert f" --tgm {generator} " in card
    assert learn(chart, generator, tmp_path / "b", "--workers", 0)[0] == weights
    other = write_tiny_generator(tmp_path / "other.safetensors", gsd_m=6.0)
    assert learn(chart, other, tmp_path / "c", "--workers", 0)[0] != weights


def test_half_of_real_pairs_are_drawn_and_real_ones_judge(generator: Path, tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, {"train": [(900, 800)], "val": [(1200, 820)]})
    _, card = learn(folder, generator, tmp_path / "a", "--workers", 0)
    assert "The thermal images of 50% were drawn" in card
    _, card = learn(folder, generator, tmp_path / "b", "--workers", 0, "--tgm-share", 0.25)
    assert "The thermal images of 25% were drawn" in card


def test_evaluation_names_the_generator_in_its_header(
    chart: Path, generator: Path, tmp_path: Path
) -> None:
    def predictions(folder: str, *options: object) -> Result:
        return run(
            evaluate,
            *(chart, "--estimator", "ncc", *SMALL, "--samples", 3, "--views", 1),
            *("--no-figures", "--out", tmp_path / folder, *options),
        )

    for folder in ("a", "b"):
        result = predictions(folder, "--tgm", generator)
        assert result.exit_code == 0, result.output
    assert predictions("plain").exit_code == 0
    first, again, plain = (
        load_predictions(tmp_path / folder / "ncc-dc128.npz") for folder in ("a", "b", "plain")
    )
    digest = hashlib.sha256(generator.read_bytes()).hexdigest()
    assert first.settings.tgm == f"tgm.safetensors@{digest[:12]}"
    assert plain.settings.tgm is None
    np.testing.assert_array_equal(first.answers_px, again.answers_px)
    np.testing.assert_array_equal(first.true_px, plain.true_px)
    assert not np.array_equal(first.answers_px, plain.answers_px)
    assert isinstance(predictions("plain", "--tgm", generator).exception, OutputError)


def test_what_makes_no_sense_is_refused(generator: Path, tmp_path: Path) -> None:
    flight = make_flight(tmp_path / "flight", 2).map.parent
    asked = ("--hfov", HFOV_DEG, "--tgm", generator, "--out", tmp_path / "out")
    for result, words in (
        (run(evaluate, flight, "--estimator", "ncc", *asked), "thermal images of its own"),
        (run(evaluate, "--stress", flight, *asked), "--stress takes flights"),
        (
            run(train, flight, *TRAINING, "--tgm-share", 1, "--out", tmp_path / "a.safetensors"),
            "--tgm-share says how much --tgm draws",
        ),
        (
            run(train, "--sand-share", 1, "--tgm", generator, "--out", tmp_path / "a.safetensors"),
            "--tgm is for --network dhn, ihn or sthn",
        ),
    ):
        assert result.exit_code == 2, result.output
        assert words in " ".join(result.stderr.split())
    assert not (tmp_path / "out").exists()
