"""Weights of displacement networks in all layouts, and what is refused."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file
from small_displacement_models import SETTINGS, small_model, small_weights

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.displacement.checkpoints import (
    load_displacement,
    serialise_checkpoint,
    serialise_folder,
    serialise_model,
)
from uasthn_cli.matching.displacement.model import DisplacementModel


def assert_equal(found: DisplacementModel, expected: DisplacementModel) -> None:
    assert found.name == expected.name
    assert found.architecture()["netG"] == expected.architecture()["netG"]
    ours, theirs = found.tensors(), expected.tensors()
    assert ours.keys() == theirs.keys()
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)


@pytest.mark.parametrize("name", ["dhn", "dhn+dm", "ihn", "sthn"])
def test_our_own_layout(name: str, tmp_path: Path) -> None:
    model = replace(small_model(name), notes={"trained_on": "nothing"})
    path = tmp_path / "own.safetensors"
    path.write_bytes(serialise_model(model))
    found = load_displacement(path)
    assert_equal(found, model)
    assert found.settings == SETTINGS
    assert found.notes == model.notes
    assert serialise_model(found) == path.read_bytes()


def test_a_dhn_written_before_there_was_a_second_head_loads(tmp_path: Path) -> None:
    model = small_model("dhn")
    described = model.architecture()
    del described["netG"]["has_uncertainty_head"]
    metadata = {"format": "uasthn-dhn-1", "architecture": json.dumps(described)}
    save_file(model.tensors(), tmp_path / "old.safetensors", metadata)
    assert_equal(load_displacement(tmp_path / "old.safetensors"), model)


@pytest.mark.parametrize("name", ["ihn", "sthn"])
@pytest.mark.parametrize("prefix", ["", "module."])
def test_the_authors_checkpoint(name: str, prefix: str, tmp_path: Path) -> None:
    model = small_model(name)
    stages: dict[str, Any] = {}
    for key, value in model.tensors().items():
        stage, _, rest = key.partition(".")
        stages.setdefault(stage, {})[prefix + rest] = value
    path = tmp_path / "STHN_best_model.pth"
    torch.save({**stages, "epoch": 3, "optimizer_G": {"state": {}, "lr": 1e-4}}, path)
    assert_equal(load_displacement(path), model)
    path.write_bytes(serialise_checkpoint(model))
    assert_equal(load_displacement(path), model)


def test_a_stage_alone_and_half_precision(tmp_path: Path) -> None:
    model = small_model("ihn")
    path = tmp_path / "stage.pth"
    halves = {f"module.{k}": v.half() for k, v in model.network.state_dict().items()}
    torch.save(halves, path)
    found = load_displacement(path)
    assert {value.dtype for value in found.tensors().values()} == {torch.float32}
    name = "netG.fnet1.conv2.weight"
    assert torch.equal(found.tensors()[name].half(), model.tensors()[name].half())


@pytest.mark.parametrize("kind", ["model.safetensors", "pytorch_model.bin"])
@pytest.mark.parametrize("prefix", ["", "model."])
def test_the_hugging_face_folder(kind: str, prefix: str, tmp_path: Path) -> None:
    model = small_model("sthn")
    weights = {prefix + name: value for name, value in model.tensors().items()}
    if kind == "model.safetensors":
        save_file(weights, tmp_path / kind)
    else:
        torch.save(weights, tmp_path / kind)
    config = {"resize_width": 256, "database_size": 1024, "fine_padding": 16, "iters_lev0": 4}
    (tmp_path / "config.json").write_text(json.dumps(config))
    for path in (tmp_path, tmp_path / kind):
        found = load_displacement(path)
        assert_equal(found, model)
        assert found.settings.width_ratio == 2.0
        assert found.settings.box_padding == 16 / 1024
        assert (found.settings.iterations, found.settings.second_iterations) == (4, 6)


def test_a_folder_written_is_read(tmp_path: Path) -> None:
    model = small_model("sthn")
    for name, content in serialise_folder(model).items():
        (tmp_path / name).write_bytes(content)
    found = load_displacement(tmp_path)
    assert_equal(found, model)
    assert found.settings == SETTINGS


class _Harmful:
    def __reduce__(self) -> tuple[Any, ...]:
        return (print, ("this ran",))


def test_nothing_is_unpickled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "harmful.pth"
    torch.save({"netG": {}, "args": _Harmful()}, path)
    with pytest.raises(WeightsError, match="unpickling could run code") as caught:
        load_displacement(path)
    assert "\n" not in str(caught.value)
    assert capsys.readouterr().out == ""


def test_what_cannot_be_used_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="no such weights file or folder"):
        load_displacement(tmp_path / "missing.pth")
    with pytest.raises(WeightsError, match="holds neither model"):
        load_displacement(tmp_path)
    for name in ("text.pth", "text.safetensors"):
        (tmp_path / name).write_text("not weights")
        with pytest.raises(WeightsError, match=name):
            load_displacement(tmp_path / name)
    torch.save({"netG": {"other": torch.ones(1)}}, tmp_path / "other.pth")
    with pytest.raises(WeightsError, match="not an IHN or STHN"):
        load_displacement(tmp_path / "other.pth")
    torch.save({"other": torch.ones(1)}, tmp_path / "other.pth")
    with pytest.raises(WeightsError, match="holds no displacement network"):
        load_displacement(tmp_path / "other.pth")
    with pytest.raises(WeightsError, match="no dhn"):
        serialise_checkpoint(small_model("dhn"))


def test_weights_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    tensors = small_model("ihn").network.state_dict()
    del tensors["fnet1.conv2.bias"]
    torch.save({"netG": tensors}, tmp_path / "less.pth")
    with pytest.raises(WeightsError, match="do not fit") as caught:
        load_displacement(tmp_path / "less.pth")
    assert "\n" not in str(caught.value)


def test_settings_that_are_not_known_are_refused(tmp_path: Path) -> None:
    save_file(small_model("ihn").tensors(), tmp_path / "model.safetensors")
    for text, words in (
        ('{"resize_width": 512}', "only 256"),
        ("[]", "not a JSON object"),
        ("{", "JSON"),
    ):
        (tmp_path / "config.json").write_text(text)
        with pytest.raises(WeightsError, match=words):
            load_displacement(tmp_path)


def test_metadata_must_state_the_architecture(tmp_path: Path) -> None:
    path = small_weights(tmp_path, "ihn")
    save_file(load_displacement(path).tensors(), path, {"format": "uasthn-ihn-1"})
    with pytest.raises(WeightsError, match="does not state its architecture"):
        load_displacement(path)


def test_the_parity_file_is_a_checkpoint_like_any(shared_dir: Path) -> None:
    found = load_displacement(shared_dir / "parity" / "uasthn_two_stage.pt")
    assert found.name == "sthn"
    assert found.architecture()["netG"]["levels"] == 4
