import sys
from types import SimpleNamespace

import pytest

from uasthn_cli.matching.waiting import wait_for_gpu


def test_torch_is_not_loaded_to_wait_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    wait_for_gpu()
    assert "torch" not in sys.modules


@pytest.mark.parametrize("in_use", [True, False])
def test_a_gpu_in_use_is_waited_for(monkeypatch: pytest.MonkeyPatch, in_use: bool) -> None:
    waits: list[bool] = []
    cuda = SimpleNamespace(is_initialized=lambda: in_use, synchronize=lambda: waits.append(True))
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(cuda=cuda))
    wait_for_gpu()
    assert waits == [True] * in_use
