"""Generators travel as data; a file that is not what it says is refused in one line."""

import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load, save
from tiny_tgm import TINY_RESNET, TINY_UNET, tiny_trained

from uasthn_cli.errors import WeightsError
from uasthn_cli.training.tgm.generators import GeneratorArchitecture
from uasthn_cli.training.tgm.weights import FORMAT, load_generator, serialise_generator


@pytest.mark.parametrize("architecture", [TINY_UNET, TINY_RESNET])
def test_a_generator_comes_back(architecture: GeneratorArchitecture, tmp_path: Path) -> None:
    trained = tiny_trained(architecture, size_px=96, gsd_m=1.25)
    (tmp_path / "t.safetensors").write_bytes(serialise_generator(trained, {"seed": "3"}))
    loaded = load_generator(tmp_path / "t.safetensors")
    assert (loaded.architecture, loaded.size_px, loaded.gsd_m) == (architecture, 96, 1.25)
    image = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        difference = (loaded.network(image) - trained.network(image)).abs().max()
    assert difference < 0.05  # of half precision


def test_equal_generators_are_equal_bytes() -> None:
    notes = {f"note {n}": "x" for n in range(8)}
    contents = {serialise_generator(tiny_trained(), notes) for _ in range(4)}
    assert len(contents) == 1


def metadata(**changes: str) -> dict[str, str]:
    architecture = json.dumps(TINY_UNET.as_metadata())
    return {
        "format": FORMAT,
        "architecture": architecture,
        "size_px": "64",
        "gsd_m": "2",
    } | changes


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "uasthn-xcorr-2"}, "not weights of a thermal generator"),
        ({"architecture": json.dumps(TINY_RESNET.as_metadata())}, "do not fit"),
        ({"architecture": "{"}, "do not fit"),
        ({"architecture": json.dumps({"kind": "gan"})}, "do not fit"),
        ({"gsd_m": "nan"}, "no sensible size"),
        ({"size_px": "0"}, "no sensible size"),
    ],
)
def test_wrong_weights_are_refused(tmp_path: Path, changes: dict[str, str], message: str) -> None:
    path = tmp_path / "t.safetensors"
    path.write_bytes(save(load(serialise_generator(tiny_trained(), {})), metadata(**changes)))
    with pytest.raises(WeightsError, match=message):
        load_generator(path)


def test_no_file_and_no_safetensors(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="no such weights file"):
        load_generator(tmp_path / "gone.safetensors")
    (tmp_path / "bad.safetensors").write_bytes(b"no tensors here")
    with pytest.raises(WeightsError, match="not a readable safetensors file"):
        load_generator(tmp_path / "bad.safetensors")
