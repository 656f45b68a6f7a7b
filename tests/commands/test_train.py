"""``uasthn train`` from the command line."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest
import torch
from click.testing import CliRunner, Result
from tiny_training import TINY_ARCHITECTURE, write_photo

from uasthn_cli.commands.main import main
from uasthn_cli.commands.train import train
from uasthn_cli.commands.training_options import ImagesType
from uasthn_cli.errors import OutputError, RunInterruptedError, TrainingDataError
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.torch_weights import load_xcorr
from uasthn_cli.training import loop, run
from uasthn_cli.training.run import Report, TrainingJob, TrainingRun

TINY: tuple[object, ...] = (
    *("--steps", 4, "--windows", 2, "--canvases", 1),
    *("--workers", 0, "--checkpoint-every", 2, "--precision", "float32"),
)
IMAGERY_ONLY = ("--sand-share", 0, "--landscape-share", 0)


class TinyRun(TrainingRun):
    """A run of a network of four channels."""

    def __init__(self, job: TrainingJob) -> None:
        super().__init__(replace(job, config=replace(job.config, architecture=TINY_ARCHITECTURE)))


class AsAskedRun(TrainingRun):
    """A run of the network that the options ask for, its job kept."""

    jobs: ClassVar[list[TrainingJob]] = []

    def __init__(self, job: TrainingJob) -> None:
        self.jobs.append(job)
        super().__init__(job)


class InterruptedRun(TinyRun):
    """A run in which somebody presses Ctrl-C after the first checkpoint."""

    def train(self, on_step: Callable[[int], None]) -> Iterator[Report]:
        yield next(super().train(on_step))
        raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "TrainingRun", TinyRun)
    monkeypatch.setattr(loop, "_VALIDATION_BATCHES", 1)
    monkeypatch.setattr("uasthn_cli.training.trainee.keep_freed_memory", lambda: None)


@pytest.fixture
def photos(tmp_path: Path) -> str:
    write_photo(tmp_path / "photos" / "a.png", 0)
    write_photo(tmp_path / "photos" / "b.jpg", 1)
    return str(tmp_path / "photos" / "*")


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(train, [str(argument) for argument in arguments])


def test_images_become_weights_card_and_log(photos: str, tmp_path: Path) -> None:
    out = tmp_path / "out" / "my.safetensors"
    result = invoke(
        "--images", f"{photos}=2", "--licence-note", "mine", *IMAGERY_ONLY, *TINY, "--out", out
    )
    assert result.exit_code == 0, result.output
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == ["step 2 of 4", "step 4 of 4"]
    assert "; validation: median error " in lines[1]
    assert lines[-1].endswith(f"weights are in {out}, their model card in {out.with_suffix('.md')}")
    assert load_xcorr(out).notes["licence_note"] == "mine"
    card = out.with_suffix(".md").read_text("utf-8")
    assert f"| `{photos}` | 2 | 2 |" in card
    assert f"uasthn train --images '{photos}=2' --sand-share 0.0 --landscape-share 0.0" in card
    assert "--precision float32" in card
    assert "Licence note: mine" in card


def test_ctrl_c_keeps_the_checkpoint_and_the_same_command_goes_on(
    photos: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def command(folder: str) -> Result:
        out = tmp_path / folder / "my.safetensors"
        return invoke("--images", photos, *IMAGERY_ONLY, *TINY, "--out", out)

    monkeypatch.chdir(tmp_path)
    assert command("unbroken").exit_code == 0
    monkeypatch.setattr(run, "TrainingRun", InterruptedRun)
    stopped = command("stopped")
    assert isinstance(stopped.exception, RunInterruptedError)
    checkpoint = tmp_path / "stopped" / "my.checkpoint.pt"
    assert str(stopped.exception) == (
        f"interrupted; step 2 of 4 is kept in {checkpoint}: give the same command again to go on"
    )
    assert not (tmp_path / "stopped" / "my.safetensors").exists()
    monkeypatch.setattr(run, "TrainingRun", TinyRun)
    resumed = command("stopped")
    assert resumed.exit_code == 0
    assert resumed.stderr.startswith(f"going on from step 2 of 4, which {checkpoint} holds\n")
    files = [tmp_path / folder / "my.safetensors" for folder in ("unbroken", "stopped")]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_another_length_is_said_another_seed_refused(photos: str, tmp_path: Path) -> None:
    base = ("--images", photos, *IMAGERY_ONLY, *TINY, "--out", tmp_path / "my.safetensors")
    assert invoke(*base).exit_code == 0
    assert isinstance(invoke(*base).exception, OutputError)
    refused = invoke(*base, "--overwrite", "--seed", 7)
    assert isinstance(refused.exception, TrainingDataError)
    assert "was begun with another --seed (0, now 7)" in str(refused.exception)
    longer = invoke(*base, "--overwrite", "--steps", 5)
    assert longer.exit_code == 0
    assert "changed on the way: from step 4: steps 5 instead of 4" in longer.stderr


def test_parts_off_sizes_and_initial_weights_reach_the_run_and_the_card(
    photos: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "TrainingRun", AsAskedRun)
    AsAskedRun.jobs.clear()
    base = ("--images", photos, *IMAGERY_ONLY, *TINY)
    first, second = tmp_path / "first.safetensors", tmp_path / "second.safetensors"
    parts = ("--without", "relief", "--without", "tone-curves")
    begun = invoke(*base, *parts, "--widths", "4,4,4,8", "--channels", 3, "--out", first)
    assert begun.exit_code == 0, begun.output
    assert AsAskedRun.jobs[0].config.samples.engine.missing == ("tone-curves", "relief")
    assert load_xcorr(first).model.architecture == XcorrArchitecture(3, (4, 4, 4, 8))
    card = first.with_suffix(".md").read_text("utf-8")
    assert "--without relief --without tone-curves" in card
    assert "--widths 4,4,4,8 --channels 3" in card
    assert "| engine without | tone-curves, relief |" in card
    refused = invoke(*base, "--widths", "4,4,4,8", "--overwrite", "--channels", 3, "--out", first)
    assert isinstance(refused.exception, TrainingDataError)
    assert "another --without relief (off, now on)" in str(refused.exception)
    onward = invoke(*base, "--init", first, "--learning-rate", 1e-9, "--out", second)
    assert onward.exit_code == 0, onward.output
    before, after = (load_xcorr(path).model.state_dict() for path in (first, second))
    assert before.keys() == after.keys()
    same = [name for name in before if name.endswith("0.weight") and before[name].ndim == 4]
    assert same
    assert all(torch.allclose(before[name], after[name], atol=1e-3) for name in same)
    assert "| started from | `first.safetensors`, SHA-256 " in second.with_suffix(".md").read_text()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("maps/*.tif", ("maps/*.tif", 1.0)),
        ("maps/*.tif=0.5", ("maps/*.tif", 0.5)),
        ("maps/*.tif=2", ("maps/*.tif", 2.0)),
        ("zoom=18/*.png", ("zoom=18/*.png", 1.0)),
        ("zoom=18/*.png=3e-1", ("zoom=18/*.png", 0.3)),
        ("a=b", ("a=b", 1.0)),
        ("a=", ("a=", 1.0)),
    ],
)
def test_patterns_and_weights(text: str, expected: tuple[str, float]) -> None:
    assert ImagesType().convert(text, None, None) == expected


@pytest.mark.parametrize("text", ["", "=2", "maps/*.tif=0", "a=-1", "a=nan", "a=inf"])
def test_weights_that_are_none_are_refused(text: str, tmp_path: Path) -> None:
    result = invoke("--images", text, "--out", tmp_path / "my.safetensors")
    assert result.exit_code == 2
    assert "--images" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "give --images, or shares that add up to 1"),
        (("--sand-share", 0.7, "--landscape-share", 0.2), "give --images"),
        (("--sand-share", 0.7, "--landscape-share", 0.7), "add up to more than 1"),
        (("--images", "a", "--sand-share", 1), "leave nothing for --images"),
        (("--sand-share", 1, "--steps", 0), "--steps"),
        (("--sand-share", 1, "--without", "clouds"), "--without"),
        (("--sand-share", 1, "--widths", "8,8,8"), "is not four whole numbers"),
        (("--sand-share", 1, "--widths", "8,8,8,x"), "is not four whole numbers"),
        (("--sand-share", 1, "--widths", "8,8,0,8"), "has a width below 1"),
        (("--sand-share", 1, "--init", "a", "--channels", 8), "--init says how large"),
        (("--sand-share", 1, "--learning-rate", 0), "--learning-rate"),
        (("--sand-share", 1, "--precision", "float64"), "--precision"),
    ],
)
def test_requests_that_cannot_be_are_refused(
    arguments: tuple[object, ...], words: str, tmp_path: Path
) -> None:
    result = invoke(*arguments, "--out", tmp_path / "my.safetensors")
    assert result.exit_code == 2
    assert words in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_rendered_sand_alone_needs_no_image(tmp_path: Path) -> None:
    result = invoke("--sand-share", 1, *TINY, "--steps", 1, "--out", tmp_path / "my.safetensors")
    assert result.exit_code == 0, result.output
    card = (tmp_path / "my.md").read_text("utf-8")
    assert "100% of the windows show rendered sand" in card
    assert "landscapes." not in card


def test_nothing_found_ends_with_its_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(
            ["train", "--images", str(tmp_path / "*.tif"), "--out", str(tmp_path / "w.safetensors")]
        )
    assert ended.value.code == TrainingDataError.exit_code
    assert "uasthn: error: no readable image of at least 128 px" in capsys.readouterr().err


def test_quiet_says_nothing(
    photos: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["train", "-q", "--images", photos, *IMAGERY_ONLY, *TINY]
    with pytest.raises(SystemExit) as ended:
        main([str(a) for a in (*arguments, "--out", tmp_path / "w.safetensors")])
    assert ended.value.code == 0
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""


def test_help_is_fast_it_loads_no_heavy_library() -> None:
    code = (
        "import sys; sys.argv = ['uasthn', 'train', '--help'];"
        "from uasthn_cli.commands.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print(sorted({'torch', 'rasterio', 'pandas', 'cv2'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ
    )
    assert done.stdout.splitlines()[-1] == "[]"
