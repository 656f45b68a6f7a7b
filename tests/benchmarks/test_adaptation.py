"""Recipes of adaptation touch what they say and nothing else."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from adaptation import RECIPES, STATISTICS, adapted
from tiny_training import TINY_ARCHITECTURE, write_photo
from torch import nn

from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_weights import load_xcorr, serialise_xcorr
from uasthn_cli.training import trainee
from uasthn_cli.training.scenes import RenderedShares


@pytest.fixture
def weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(trainee, "keep_freed_memory", lambda: None)
    torch.manual_seed(0)
    path = tmp_path / "w.safetensors"
    path.write_bytes(serialise_xcorr(XcorrModel(TINY_ARCHITECTURE), {}))
    return path


def changed(weights: Path, name: str) -> set[str]:
    """Return the names of the tensors that a recipe changes in two steps on a photograph."""
    recipe = RECIPES[name]
    if recipe is not None:
        recipe = replace(recipe, rendered=RenderedShares(0.0, 0.0))
    photo = write_photo(weights.parent / "map.png")
    before = load_xcorr(weights).model.state_dict()
    after = adapted(weights, photo, recipe, 2, weights.parent / "c.pt").state_dict()
    return {key for key in before if not torch.equal(before[key], after[key])}


def test_statistics_are_those_of_the_satellite_encoder(weights: Path) -> None:
    touched = changed(weights, STATISTICS)
    assert touched
    assert {key.split(".")[0] for key in touched} == {"satellite_encoder"}
    assert {key.split(".")[-1] for key in touched} == {
        "running_mean",
        "running_var",
        "num_batches_tracked",
    }


def test_the_thermal_encoder_is_left_alone(weights: Path) -> None:
    touched = changed(weights, "map and rendered, satellite encoder")
    assert {key.split(".")[0] for key in touched} == {"satellite_encoder", "log_temperature"}


def test_affine_trains_scales_and_offsets_alone(weights: Path) -> None:
    touched = changed(weights, "map only, affine")
    model = XcorrModel(TINY_ARCHITECTURE)
    norms = {name for name, module in model.named_modules() if isinstance(module, nn.BatchNorm2d)}
    assert touched
    assert {key.rsplit(".", 1)[0] for key in touched} <= norms
    assert {key.rsplit(".", 1)[1] for key in touched} <= {"weight", "bias"}
