"""Estimators by name, and the devices they run on."""

from pathlib import Path

import pytest
import torch
from small_displacement_models import small_weights

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching import device
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.device import choose_device
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.registry import BUILT_IN, estimator_names, open_estimator, spec_of
from uasthn_cli.matching.torch_weights import serialise_xcorr


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.safetensors"
    path.write_bytes(serialise_xcorr(XcorrModel(XcorrArchitecture(4, (4, 4, 4, 4))), {}))
    return path


@pytest.mark.parametrize("name", [name for name in BUILT_IN if name != "vismatch"])
def test_estimators_answer_to_their_name(name: str, weights: Path, tmp_path: Path) -> None:
    files = {"xcorr": [weights], "ncc": []}
    chosen = files[name] if name in files else [small_weights(tmp_path, name)]
    estimator = open_estimator(name, weights=chosen, device="cpu")
    assert estimator.name == name
    assert estimator.halo_px % estimator.stride_px == 0


def test_weights_for_an_estimator_without_any_are_refused(weights: Path) -> None:
    with pytest.raises(WeightsError, match="ncc uses no weights"):
        open_estimator("ncc", weights=[weights])


@pytest.mark.parametrize("name", ["xcorr", "ncc", "dhn", "vismatch:xfeat"])
def test_early_stopping_of_an_estimator_without_steps_is_refused(name: str) -> None:
    with pytest.raises(WeightsError, match="no steps that could be stopped"):
        open_estimator(name, ue_iterations=2)


def test_only_xcorr_is_several_networks_in_one(weights: Path, tmp_path: Path) -> None:
    second = tmp_path / "second.safetensors"
    second.write_bytes(weights.read_bytes())
    both = open_estimator("xcorr", weights=[weights, second], device="cpu")
    assert both.name == "xcorr"
    with pytest.raises(WeightsError, match="ihn is one network"):
        open_estimator("ihn", weights=[weights, second])
    with pytest.raises(WeightsError, match="leave out --weights"):
        open_estimator("xcorr", weights=[weights, second], ensemble=True)


def test_what_is_asked_of_names_stands_in_their_specifications() -> None:
    def having(question: str) -> list[str]:
        return [name for name, spec in BUILT_IN.items() if getattr(spec, question)]

    assert estimator_names()[:6] == ("xcorr", "ncc", "dhn", "ihn", "sthn", "vismatch:NAME")
    for question in ("averages", "has_ensemble", "has_symmetries", "second_scale", "calibration"):
        assert having(question) == ["xcorr"]
    assert having("scores_shifts") == having("working_width_px") == ["xcorr", "ncc"]
    assert having("may_have_head") == ["dhn", "ihn", "sthn"]
    assert having("has_early_stopping") == ["ihn", "sthn"]
    assert spec_of("vismatch:xfeat").name == "vismatch"
    assert all(path.is_file() for path in spec_of("xcorr").bundled_weights)


def test_an_unknown_estimator_is_named_with_those_known() -> None:
    with pytest.raises(ValueError, match="unknown estimator 'sift'; known: xcorr, ncc, dhn"):
        open_estimator("sift")


@pytest.mark.parametrize(
    ("requested", "has_gpu", "chosen"),
    [
        ("auto", False, "cpu"),
        ("auto", True, "cuda"),
        ("cpu", True, "cpu"),
        ("cuda", True, "cuda"),
        ("cuda", False, "cpu"),
    ],
)
def test_the_gpu_is_used_when_wanted_and_there(
    requested: str, has_gpu: bool, chosen: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device, "_has_driver", lambda: has_gpu)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: has_gpu)
    assert choose_device(requested) == chosen


def test_a_missing_gpu_is_mentioned(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    choose_device("auto")
    assert not caplog.records
    choose_device("cuda")
    assert "no CUDA device" in caplog.text
