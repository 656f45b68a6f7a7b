"""The encoders by ONNX Runtime give what torch gives, for the same weights."""

from pathlib import Path

import numpy as np
import pytest
import torch

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.encoders import OnnxEncoders, open_encoders
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_encoders import TorchEncoders
from uasthn_cli.matching.torch_weights import load_xcorr, serialise_xcorr
from uasthn_cli.types import BoolArray, ImageArray, MapStatistics

STATISTICS = MapStatistics((0.4, 0.5, 0.3), 0.2)


def lively_model(seed: int) -> XcorrModel:
    """Return a small network whose batch norms do something."""
    torch.manual_seed(seed)
    model = XcorrModel(XcorrArchitecture(feature_channels=3, widths=(4, 6, 8, 10)))
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_()  # type: ignore[union-attr]
            module.running_var.uniform_(0.5, 2.0)  # type: ignore[union-attr]
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.normal_(module.bias)
    return model.eval()


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "lively.safetensors"
    path.write_bytes(serialise_xcorr(lively_model(0), {}))
    return path


def picture(channels: int, shape: tuple[int, int]) -> tuple[ImageArray, BoolArray]:
    draw = np.random.default_rng(1)
    valid = np.ones(shape, np.bool_)
    valid[:, :21], valid[30:40, 50:60] = False, False
    return draw.random((channels, *shape), np.float32) * valid, valid


@pytest.mark.parametrize("shape", [(64, 96), (128, 80)])
def test_both_engines_agree_on_maps_and_frames(weights: Path, shape: tuple[int, int]) -> None:
    onnx = open_encoders(weights, "cpu")
    by_torch = TorchEncoders(load_xcorr(weights).model)
    assert isinstance(onnx, OnnxEncoders)
    assert (onnx.channels, onnx.temperature) == pytest.approx(
        (by_torch.channels, by_torch.temperature)
    )
    rgb, valid = picture(3, shape)
    expected = by_torch.satellite(rgb, valid, STATISTICS)
    assert expected.shape == (3, shape[0] // 2, shape[1] // 2)
    assert onnx.satellite(rgb, valid, STATISTICS) == pytest.approx(expected, abs=2e-4)
    thermal = picture(1, shape)[0][0]
    expected = by_torch.thermal(thermal, valid)
    assert onnx.thermal(thermal, valid) == pytest.approx(expected, abs=2e-4)


def test_equal_weights_have_one_identity_and_others_another(weights: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.safetensors"
    other.write_bytes(serialise_xcorr(lively_model(1), {}))
    first = open_encoders(weights, "cpu").identity
    assert first == open_encoders(weights, "cpu").identity
    assert first != open_encoders(other, "cpu").identity
    assert first != TorchEncoders(load_xcorr(weights).model).identity


def test_weights_without_a_tensor_are_refused_in_one_line(tmp_path: Path) -> None:
    model = lively_model(0)
    del model.satellite_encoder.up2
    path = tmp_path / "torn.safetensors"
    path.write_bytes(serialise_xcorr(model, {}))
    with pytest.raises(WeightsError, match="do not fit their stated architecture"):
        open_encoders(path, "cpu")
