"""Checkpoints: whole or not at all, without code, and only for the run they belong to."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import torch

from uasthn_cli.errors import OutputError, TrainingDataError
from uasthn_cli.training.checkpoint import (
    TrainingState,
    changes_on_resume,
    load_checkpoint,
    require_same_run,
    save_checkpoint,
)
from uasthn_cli.training.engine import EngineConfig

SETTINGS: dict[str, Any] = {
    "steps": 100,
    "seed": 3,
    "learning_rate": 0.002,
    "device": "cpu",
    "bfloat16": True,
    "workers": 1,
    "checkpoint_every": 50,
    "samples": {"windows": 8, "canvases": 4, "engine": asdict(EngineConfig())},
    "architecture": {"feature_channels": 24, "widths": (32, 64, 96, 128)},
    "data": "abc",
    "initial": "",
    "changes": [],
}


def state(step: int = 7) -> TrainingState:
    return TrainingState(step, {"weight": torch.arange(6.0)}, {"state": {}}, SETTINGS)


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    path = tmp_path / "a.checkpoint.pt"
    save_checkpoint(path, state(7))
    save_checkpoint(path, state(8))
    loaded = load_checkpoint(path)
    assert loaded.step == 8
    assert torch.equal(loaded.model["weight"], torch.arange(6.0))
    assert loaded.settings == SETTINGS
    assert list(tmp_path.iterdir()) == [path], "no temporary file stays"


def test_a_checkpoint_that_cannot_be_written_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.checkpoint.pt"
    save_checkpoint(path, state(7))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("uasthn_cli.outputs.atomic._write_through", full)
    with pytest.raises(OutputError, match="No space left"):
        save_checkpoint(path, state(8))
    assert load_checkpoint(path).step == 7


class Bomb:
    """Would run code where a checkpoint is unpickled without care."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (Path("exploded"),))


def damaged_files(folder: Path) -> list[Path]:
    whole = folder / "whole.pt"
    save_checkpoint(whole, state())
    contents: dict[str, Any] = {"list": [1, 2], "tensor": torch.ones(3), "lacking": {"step": 1}}
    contents |= {"bomb": {"step": Bomb()}, "step": {"step": "x", "model": {}, "optimiser": {}}}
    for name, content in contents.items():
        torch.save(content, folder / f"{name}.pt")
    (folder / "empty.pt").write_bytes(b"")
    (folder / "text.pt").write_text("not a checkpoint")
    (folder / "cut.pt").write_bytes(whole.read_bytes()[:500])
    (folder / "folder.pt").mkdir()
    return [path for path in sorted(folder.iterdir()) if path != whole]


def test_what_is_no_checkpoint_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    paths = damaged_files(tmp_path)
    assert len(paths) == 9
    for path in paths:
        with pytest.raises(TrainingDataError) as refused:
            load_checkpoint(path)
        assert str(refused.value).startswith(f"{path}: not a checkpoint")
        assert "\n" not in str(refused.value)
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 4}, "another --seed (3, now 4)"),
        ({"learning_rate": 0.001}, "another --learning-rate (0.002, now 0.001)"),
        ({"samples": {"windows": 4, "canvases": 4}}, "another --windows (8, now 4)"),
        ({"samples": {"windows": 8, "canvases": 2}}, "another --canvases (4, now 2)"),
        (
            {"samples": {"engine": asdict(EngineConfig(cluster_temperatures=False))}},
            "another --without cluster-temperatures (on, now off)",
        ),
        ({"initial": "def"}, "another --init;"),
        ({"data": "xyz"}, "another --images or"),
        ({"architecture": {"feature_channels": 8, "widths": (32, 64, 96, 128)}}, "--channels"),
        ({"architecture": {"feature_channels": 24, "widths": (8, 8, 8, 8)}}, "--widths"),
    ],
)
def test_other_runs_are_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(TrainingDataError) as refused:
        require_same_run(Path("a.checkpoint.pt"), SETTINGS, SETTINGS | change)
    assert words in str(refused.value)
    assert "delete the checkpoint" in str(refused.value)


def test_the_same_run_may_change_its_length_its_machine_and_its_pace() -> None:
    changed = {"steps": 200, "device": "cuda", "bfloat16": False, "workers": 4}
    changed |= {"checkpoint_every": 10, "changes": ["something"]}
    require_same_run(Path("a.checkpoint.pt"), SETTINGS, SETTINGS | changed)
    widths = {"feature_channels": 24, "widths": [32, 64, 96, 128]}
    require_same_run(Path("a.checkpoint.pt"), SETTINGS, SETTINGS | {"architecture": widths})


def test_settings_that_an_older_version_did_not_know_are_not_compared() -> None:
    older = {key: value for key, value in SETTINGS.items() if key not in ("data", "changes")}
    require_same_run(Path("a.checkpoint.pt"), older, SETTINGS)
    assert changes_on_resume(10, older, SETTINGS) == []


def test_changes_are_remembered_in_order() -> None:
    longer = SETTINGS | {"steps": 200, "workers": 2}
    first = changes_on_resume(50, SETTINGS, longer)
    assert first == ["from step 50: steps 200 instead of 100"]
    second = changes_on_resume(150, longer | {"changes": first}, longer | {"device": "cuda"})
    assert second == [*first, "from step 150: device cuda instead of cpu"]
