"""Weights travel as data; a file that is not what it says is refused in one line."""

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load, save

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_weights import load_xcorr, serialise_xcorr
from uasthn_cli.matching.weights import canonical_safetensors

ARCHITECTURE = XcorrArchitecture(feature_channels=5, widths=(4, 6, 8, 10))


@pytest.fixture(scope="module")
def model() -> XcorrModel:
    torch.manual_seed(0)
    model = XcorrModel(ARCHITECTURE)
    # batch norm statistics away from their defaults
    for _ in range(3):
        model.encode_thermal(torch.rand(2, 1, 32, 48), torch.ones(2, 1, 32, 48))
    return model.eval()


@pytest.fixture(scope="module")
def content(model: XcorrModel) -> bytes:
    return serialise_xcorr(model, {"trained_on": "noise", "seed": "0"})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "weights.safetensors"


def test_what_was_saved_is_loaded(model: XcorrModel, content: bytes, path: Path) -> None:
    path.write_bytes(content)
    loaded = load_xcorr(path)
    assert loaded.model.architecture == ARCHITECTURE
    assert loaded.notes["trained_on"] == "noise"
    assert not loaded.model.training
    image, valid = torch.rand(1, 1, 32, 48), torch.ones(1, 1, 32, 48)
    with torch.inference_mode():
        expected = model.encode_thermal(image, valid)
        found = loaded.model.encode_thermal(image, valid)
    torch.testing.assert_close(found, expected, atol=5e-3, rtol=5e-3)  # half precision


def test_equal_weights_give_equal_bytes(model: XcorrModel) -> None:
    notes = {name: name for name in ("a", "b", "c", "d")}
    assert len({serialise_xcorr(model, notes) for _ in range(5)}) == 1


def test_loaded_weights_are_saved_unchanged(content: bytes, path: Path) -> None:
    path.write_bytes(content)
    loaded = load_xcorr(path)
    notes = {name: loaded.notes[name] for name in ("trained_on", "seed")}
    assert serialise_xcorr(loaded.model, notes) == content


def test_a_file_is_half_as_large_as_its_model(model: XcorrModel, content: bytes) -> None:
    full = sum(value.numel() * 4 for value in model.state_dict().values())
    header = len(json.dumps({name: "" for name in model.state_dict()})) * 4
    assert len(content) < 0.6 * full + header


def test_a_missing_file_is_named(path: Path) -> None:
    with pytest.raises(WeightsError, match=r"weights\.safetensors: no such weights file"):
        load_xcorr(path)


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:4],
        lambda content: content[: len(content) // 2],
        lambda content: content[:-1],
        lambda content: b"\x89PNG\r\n\x1a\n" + content,
        lambda content: b"PK\x03\x04" * 100,
    ],
)
def test_a_damaged_file_is_refused(
    damage: Callable[[bytes], bytes], content: bytes, path: Path
) -> None:
    path.write_bytes(damage(content))
    with pytest.raises(WeightsError, match="not a readable safetensors file"):
        load_xcorr(path)


@pytest.mark.parametrize("metadata", [None, {"format": "uasthn-xcorr-1"}])
def test_safetensors_of_another_format_are_refused(
    metadata: dict[str, str] | None, path: Path
) -> None:
    path.write_bytes(save({"layer.weight": torch.zeros(3, 3)}, metadata))
    with pytest.raises(WeightsError, match="not for the xcorr estimator"):
        load_xcorr(path)


@pytest.mark.parametrize(
    "stated",
    [
        None,
        "not JSON",
        "[1, 2]",
        json.dumps({"feature_channels": 5}),
        json.dumps({"feature_channels": 5, "widths": [4, 6, 8]}),
        json.dumps({"feature_channels": 6, "widths": [4, 6, 8, 10]}),
        json.dumps({"feature_channels": "many", "widths": [4, 6, 8, 10]}),
    ],
)
def test_weights_of_another_architecture_are_refused(
    stated: str | None, model: XcorrModel, path: Path
) -> None:
    metadata = {"format": "uasthn-xcorr-2"}
    metadata |= {} if stated is None else {"architecture": stated}
    path.write_bytes(save(dict(model.state_dict()), metadata))
    with pytest.raises(WeightsError, match="do not fit their stated architecture"):
        load_xcorr(path)


def test_a_missing_tensor_is_noticed(model: XcorrModel, path: Path) -> None:
    tensors = dict(model.state_dict())
    del tensors["thermal_encoder.head.weight"]
    metadata = {
        "format": "uasthn-xcorr-2",
        "architecture": json.dumps(ARCHITECTURE.as_metadata()),
    }
    path.write_bytes(save(tensors, metadata))
    with pytest.raises(WeightsError, match="do not fit"):
        load_xcorr(path)


def test_canonical_files_hold_the_same_and_are_sorted(tmp_path: Path) -> None:
    rng = random.Random(0)
    tensors = {f"t{n}": torch.full((2, n + 1), float(n)) for n in range(6)}
    notes = {f"note {n}": "ä" * n for n in range(9)}
    contents = set()
    for _ in range(6):
        shuffled = dict(rng.sample(sorted(notes.items()), len(notes)))
        contents.add(canonical_safetensors(save(tensors, shuffled)))
    (content,) = contents
    assert canonical_safetensors(content) == content
    loaded = load(content)
    assert loaded.keys() == tensors.keys()
    assert all(torch.equal(loaded[name], tensors[name]) for name in tensors)
    (tmp_path / "w.safetensors").write_bytes(content)
    with safe_open(tmp_path / "w.safetensors", framework="pt") as file:
        assert file.metadata() == notes
    length = int.from_bytes(content[:8], "little")
    assert length % 8 == 0
    header = json.loads(content[8 : 8 + length])
    assert list(header) == sorted(header)
