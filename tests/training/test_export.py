"""Weights and model card: whole, loadable, the same bytes for the same run."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tiny_training import tiny_config

from uasthn_cli import __version__
from uasthn_cli.errors import OutputError
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_weights import load_xcorr
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.export import (
    OutputPaths,
    TrainingStory,
    export,
)
from uasthn_cli.training.loop import Validation
from uasthn_cli.training.samples import SampleConfig
from uasthn_cli.training.scenes import ImageSource, RenderedShares
from uasthn_cli.training.trainee import InitialWeights

STORY = TrainingStory(
    config=tiny_config(steps=123, seed=45),
    sources=(ImageSource("maps/*.tif", 1.5, 10), ImageSource("photos/**/*.jpg", 1.0, 200)),
    rendered=RenderedShares(sand=0.2, landscapes=0.3),
    threads=2,
    changes=("from step 100: steps 123 instead of 110",),
    validation=Validation(1.234, 0.9375),
    licence_note="public domain",
    command_line="uasthn train --images 'maps/*.tif=1.5'",
)


@pytest.fixture(scope="module")
def model() -> XcorrModel:
    torch.manual_seed(0)
    return XcorrModel(tiny_config().architecture)


@pytest.fixture
def paths(tmp_path: Path) -> OutputPaths:
    return OutputPaths(tmp_path / "deep" / "my.best.safetensors")


def test_files_are_named_after_the_weights(paths: OutputPaths) -> None:
    names = [path.name for path in (paths.card, paths.log, paths.checkpoint)]
    assert names == ["my.best.md", "my.best.log.csv", "my.best.checkpoint.pt"]


def test_weights_load_again(paths: OutputPaths, model: XcorrModel) -> None:
    paths.prepare(overwrite=False)
    export(paths, model, STORY)
    loaded = load_xcorr(paths.weights)
    assert loaded.model.architecture == model.architecture
    for name, value in loaded.model.state_dict().items():
        assert torch.allclose(value.float(), model.state_dict()[name].float(), atol=2e-3), name
    assert loaded.notes["version"] == __version__
    assert loaded.notes["seed"] == "45"
    assert loaded.notes["licence_note"] == "public domain"
    assert sorted(paths.weights.parent.iterdir()) == [paths.card, paths.weights]


def test_the_card_tells_the_story(paths: OutputPaths, model: XcorrModel) -> None:
    paths.prepare(overwrite=False)
    export(paths, model, STORY)
    card = paths.card.read_text("utf-8")
    count = sum(parameter.numel() for parameter in model.parameters())
    for line in (
        "# my.best.safetensors",
        "50% of the windows show overhead imagery through random pseudo-thermal renderings:",
        "| `maps/*.tif` | 10 | 1.5 |",
        "| `photos/**/*.jpg` | 200 | 1 |",
        "20% of the windows show rendered sand: dunes, tracks, plots, scrub.",
        "30% of the windows show rendered landscapes.",
        "Licence note: public domain",
        f"| uasthn | {__version__} |",
        "| steps | 123 |",
        "| batch | 2 windows × 1 thermal views |",
        "| seed | 45 |",
        "| precision | float32 |",
        "| threads | 2 |",
        "| started from | random weights |",
        "| engine without | nothing: all parts are on |",
        "Changed on the way: from step 100: steps 123 instead of 110.",
        "uasthn train --images 'maps/*.tif=1.5'",
        "| median error of the search | 1.23 px |",
        "| searches within 4 px | 93.8% |",
        "| widths of an encoder's four levels | 4, 4, 4, 4 |",
        f"| parameters | {count:,} |",
    ):
        assert line in card.splitlines(), line


def test_the_card_says_what_was_other_than_usual(paths: OutputPaths, model: XcorrModel) -> None:
    paths.prepare(overwrite=False)
    samples = SampleConfig(engine=EngineConfig(relief=False, map_appearance=False))
    story = replace(
        STORY,
        config=tiny_config(samples=samples),
        initial=InitialWeights("other.safetensors", "ab" * 32, model),
    )
    export(paths, model, story)
    card = paths.card.read_text("utf-8").splitlines()
    assert f"| started from | `other.safetensors`, SHA-256 {'ab' * 32} |" in card
    assert "| engine without | relief, map-appearance |" in card


def test_the_card_says_what_is_lacking(paths: OutputPaths, model: XcorrModel) -> None:
    paths.prepare(overwrite=False)
    bare = replace(
        STORY,
        sources=(),
        rendered=RenderedShares(1.0, 0.0),
        changes=(),
        licence_note=None,
        command_line=None,
    )
    export(paths, model, bare)
    card = paths.card.read_text("utf-8")
    assert "overhead imagery" not in card
    assert "Licence note: none was given." in card
    assert "Changed" not in card
    assert "```" not in card


def test_the_same_run_gives_the_same_bytes(paths: OutputPaths, model: XcorrModel) -> None:
    paths.prepare(overwrite=False)
    export(paths, model, STORY)
    before = paths.weights.read_bytes(), paths.card.read_bytes()
    for _ in range(5):
        export(paths, model, STORY)
        assert (paths.weights.read_bytes(), paths.card.read_bytes()) == before


@pytest.mark.parametrize("name", ["weights", "card", "log"])
def test_what_exists_is_not_replaced_unasked(name: str, paths: OutputPaths) -> None:
    path: Path = getattr(paths, name)
    path.parent.mkdir()
    path.write_text("precious")
    with pytest.raises(OutputError, match=f"already holds {path.name}: .*--overwrite"):
        paths.prepare(overwrite=False)
    paths.prepare(overwrite=True)
    assert path.read_text() == "precious", "replaced when there is something better, not before"


def test_an_interrupted_run_finds_its_log_in_place(paths: OutputPaths) -> None:
    paths.prepare(overwrite=False)
    paths.log.write_text("rows")
    paths.checkpoint.write_text("state")
    paths.prepare(overwrite=False)


def test_what_killed_runs_left_half_written_is_removed(paths: OutputPaths) -> None:
    paths.weights.parent.mkdir()
    leftover = paths.weights.parent / f".{paths.checkpoint.name}.123.tmp"
    leftover.write_text("half")
    paths.prepare(overwrite=False)
    assert list(paths.weights.parent.iterdir()) == []


def test_outputs_that_cannot_be_are_refused_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"give --out a name that ends in \.safetensors"):
        OutputPaths(tmp_path / "weights.pt").prepare(overwrite=False)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot create"):
        OutputPaths(tmp_path / "file" / "w.safetensors").prepare(overwrite=False)
    (tmp_path / "w.safetensors").mkdir()
    with pytest.raises(OutputError, match="is a folder"):
        OutputPaths(tmp_path / "w.safetensors").prepare(overwrite=True)
