"""bfloat16 where hardware computes in it, and where it is asked for."""

import pytest
import torch

from uasthn_cli.config import Precision
from uasthn_cli.training.precision import use_bfloat16


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_what_is_asked_for_is_done(device: str) -> None:
    assert use_bfloat16(Precision.BFLOAT16, device)
    assert not use_bfloat16(Precision.FLOAT32, device)


@pytest.mark.parametrize(
    ("avx512", "amx", "expected"),
    [(True, True, True), (True, False, True), (False, True, True), (False, False, False)],
)
def test_cpu(avx512: bool, amx: bool, expected: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: avx512, raising=False)
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: amx, raising=False)
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: True)
    assert use_bfloat16(Precision.AUTO, "cpu") is expected
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: False)
    assert use_bfloat16(Precision.AUTO, "cpu") is False


def test_a_version_of_torch_that_cannot_tell_means_float32(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(torch.cpu, "_is_avx512_bf16_supported", raising=False)
    monkeypatch.delattr(torch.cpu, "_is_amx_tile_supported", raising=False)
    assert use_bfloat16(Precision.AUTO, "cpu") is False


@pytest.mark.parametrize("native", [True, False])
def test_gpu(native: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation=True: native)
    assert use_bfloat16(Precision.AUTO, "cuda") is native
