"""``uasthn tgm`` from the command line."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from affine import Affine
from click.testing import CliRunner, Result
from tiny_tgm import TINY_UNET, pair, write_tiny_generator

from uasthn_cli.commands import tgm_train
from uasthn_cli.commands.main import main
from uasthn_cli.errors import (
    DatasetError,
    MapUnreadableError,
    OutputError,
    TrainingDataError,
    WeightsError,
)
from uasthn_cli.training.tgm import run
from uasthn_cli.training.tgm.config import Preset
from uasthn_cli.training.tgm.generators import GeneratorKind
from uasthn_cli.training.tgm.run import TgmJob, TgmReport, TgmRun

TINY = ("--steps", 4, "--checkpoint-every", 2, "--device", "cpu")


class TinyRun(TgmRun):
    """A run of a small network on small images."""

    def __init__(self, job: TgmJob) -> None:
        config = replace(
            job.config, architecture=TINY_UNET, discriminator_width=4, size_px=64, jitter_px=6
        )
        super().__init__(replace(job, config=config))


class InterruptedRun(TinyRun):
    """A run in which somebody presses Ctrl-C after the first checkpoint."""

    def train(self, on_step: Callable[[int], None]) -> Iterator[TgmReport]:
        yield next(super().train(on_step))
        raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "TgmRun", TinyRun)
    monkeypatch.setattr("uasthn_cli.training.tgm.trainee.keep_freed_memory", lambda: None)


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["tgm", *map(str, arguments)])


def write_pairs(folder: Path, first: int = 0) -> Path:
    """Write two pairs and their table."""
    folder.mkdir()
    lines = ["name,satellite,thermal,satellite_gsd_m,center_x,center_y,thermal_gsd_m"]
    for number in range(first, first + 2):
        sample = pair(number)
        assert cv2.imwrite(str(folder / f"s{number}.png"), sample.satellite[..., ::-1])
        assert cv2.imwrite(str(folder / f"t{number}.png"), sample.thermal)
        lines.append(f"pair {number},s{number}.png,t{number}.png,2,59.5,59.5,2")
    table = folder / "pairs.csv"
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return table


@pytest.fixture
def pairs(tmp_path: Path) -> Path:
    return write_pairs(tmp_path / "pairs")


@pytest.fixture
def map_path(tmp_path: Path) -> Path:
    pixels = np.random.default_rng(0).integers(1, 256, (3, 70, 90), dtype=np.uint8)
    path = tmp_path / "map.tif"
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=70,
        width=90,
        count=3,
        dtype="uint8",
        crs="EPSG:32640",
        transform=Affine(2, 0, 5e5, 0, -2, 2.6e6),
    ) as target:
        target.write(pixels)
    return path


def test_pairs_become_a_generator_and_a_map_its_thermal_image(
    pairs: Path, map_path: Path, tmp_path: Path
) -> None:
    other = write_pairs(tmp_path / "other", first=9)
    out, thermal = tmp_path / "out" / "t.safetensors", tmp_path / "thermal.tif"
    trained = invoke("train", pairs, "--validate", other.parent, *TINY, "--out", out)
    assert trained.exit_code == 0, trained.output
    assert trained.stdout == ""
    lines = trained.stderr.splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == ["step 2 of 4", "step 4 of 4"]
    assert "; validation: L1 " in lines[1]
    assert lines[-1] == f"weights are in {out}, their model card in {out.with_suffix('.md')}"
    drawn = invoke("generate", out, map_path, "--out", thermal, "--device", "cpu")
    assert drawn.exit_code == 0, drawn.output
    assert drawn.stderr.endswith(f"the thermal image of {map_path} is in {thermal}\n")
    with rasterio.open(thermal) as source:
        assert (source.count, source.width, source.height) == (1, 90, 70)
        assert source.transform == Affine(2, 0, 5e5, 0, -2, 2.6e6)


def test_ctrl_c_keeps_the_checkpoint_and_the_same_command_goes_on(
    pairs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def command(folder: str) -> Result:
        return invoke("train", pairs, *TINY, "--out", tmp_path / folder / "t.safetensors")

    assert command("unbroken").exit_code == 0
    monkeypatch.setattr(run, "TgmRun", InterruptedRun)
    stopped = command("stopped")
    checkpoint = tmp_path / "stopped" / "t.checkpoint.pt"
    assert stopped.exit_code == 130
    assert stopped.stderr.endswith(
        f"interrupted; step 2 of 4 is kept in {checkpoint}: give the same command again to go on\n"
    )
    monkeypatch.setattr(run, "TgmRun", TinyRun)
    resumed = command("stopped")
    assert resumed.exit_code == 0
    assert resumed.stderr.startswith(f"going on from step 2 of 4, which {checkpoint} holds\n")
    files = [tmp_path / folder / "t.safetensors" for folder in ("unbroken", "stopped")]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_quiet_says_nothing(pairs: Path, tmp_path: Path) -> None:
    result = invoke("train", pairs, *TINY, "--out", tmp_path / "t.safetensors", "-q")
    assert (result.exit_code, result.output) == (0, "")


def test_wrong_inputs_are_one_line_with_their_code(
    pairs: Path, map_path: Path, tmp_path: Path
) -> None:
    weights = write_tiny_generator(tmp_path / "t.safetensors")
    fine = write_tiny_generator(tmp_path / "fine.safetensors", gsd_m=0.01)
    gone, out = tmp_path / "gone", tmp_path / "out.safetensors"
    thermal = tmp_path / "thermal.tif"
    cases = {
        ("train", gone, "--out", out): DatasetError,
        ("train", pairs, "--out", weights): OutputError,
        ("train", pairs, "--out", tmp_path / "t.pt"): OutputError,
        ("train", pairs, "--validate", pairs, "--out", out): TrainingDataError,
        ("generate", gone, map_path, "--out", thermal): WeightsError,
        ("generate", map_path, map_path, "--out", thermal): WeightsError,
        ("generate", weights, gone, "--out", thermal): MapUnreadableError,
        ("generate", weights, pairs, "--out", thermal): MapUnreadableError,
        ("generate", weights, map_path, "--out", map_path): OutputError,
        ("generate", fine, map_path, "--out", thermal): TrainingDataError,
    }
    for arguments, error in cases.items():
        result = invoke(*arguments)
        assert result.exit_code == error.exit_code, (arguments, result.output)
        assert result.stderr.startswith("uasthn: error: ")
        assert result.stderr.count("\n") == 1
    assert not thermal.exists()


@pytest.mark.parametrize("typed", ["--steps 0", "--generator vit", "--preset gpu", "--batch 0"])
def test_nonsense_is_a_usage_error(typed: str, pairs: Path, tmp_path: Path) -> None:
    result = invoke("train", pairs, *typed.split(), "--out", tmp_path / "t.safetensors")
    assert result.exit_code == 2
    assert typed.split(maxsplit=1)[0] in result.stderr


def test_presets_and_what_changes_them() -> None:
    paper = tgm_train._config("paper-tgm", "unet", None, 30, None, 1, 0, 500)
    assert (paper.steps, paper.architecture.width, paper.discriminator_width) == (6000, 64, 64)
    assert (paper.learning_rate, paper.betas, paper.l1_weight) == (2e-4, (0.5, 0.999), 100.0)
    assert tgm_train._config("paper-tgm", "unet", None, 30, None, 4, 0, 500).steps == 1600
    laptop = tgm_train._config("laptop", "resnet", None, 30, 70, 1, 0, 500)
    assert (laptop.steps, laptop.architecture.width) == (70, 16)
    assert laptop.architecture.kind is GeneratorKind.RESNET
    assert tgm_train._config("laptop", "unet", 8, 30, None, 1, 0, 500).discriminator_width == 8


def test_choices_offered_are_those_there_are() -> None:
    assert tuple(GeneratorKind) == tgm_train.GENERATORS
    assert tuple(Preset) == tgm_train.PRESETS


@pytest.mark.parametrize("name", ["train", "generate"])
def test_help(name: str) -> None:
    result = CliRunner().invoke(main, ["tgm", name, "--help"], terminal_width=80)
    assert result.exit_code == 0
    assert "--quiet" in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 100
