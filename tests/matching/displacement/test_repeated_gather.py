"""Gathering with one shared gradient: the values and gradients are autograd's own."""

import gc
import weakref

import pytest
import torch
from torch import Tensor

from uasthn_cli.matching.displacement.repeated_gather import RepeatedGather


def indices(seed: int) -> Tensor:
    return torch.randint(0, 12, (3, 7), generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.bfloat16])
def test_values_and_gradients_are_those_of_plain_gathers(dtype: torch.dtype) -> None:
    source = torch.arange(36.0, dtype=dtype).reshape(3, 12).requires_grad_()
    plain_source = source.detach().clone().requires_grad_()
    gather = RepeatedGather(source * 2)
    plain = plain_source * 2
    pairs = [(gather(indices(n)), plain.gather(1, indices(n))) for n in range(3)]
    assert all(torch.equal(ours, theirs) for ours, theirs in pairs)
    sum((n + 1) * ours.sum() for n, (ours, _) in enumerate(pairs)).backward()  # type: ignore[union-attr]
    sum((n + 1) * theirs.sum() for n, (_, theirs) in enumerate(pairs)).backward()  # type: ignore[union-attr]
    assert torch.equal(source.grad, plain_source.grad)  # type: ignore[arg-type]
    assert source.grad is not None and source.grad.dtype == dtype


def test_what_is_not_used_gets_no_gradient() -> None:
    source = torch.ones(3, 12, requires_grad=True)
    gather = RepeatedGather(source * 1)
    gather(indices(0))
    (source * 3).sum().backward()  # type: ignore[no-untyped-call]
    assert torch.equal(source.grad, torch.full((3, 12), 3.0))  # type: ignore[arg-type]


def test_without_gradients_it_is_a_gather() -> None:
    source = torch.ones(3, 12, requires_grad=True)
    with torch.no_grad():
        assert not RepeatedGather(source)(indices(0)).requires_grad
    assert not RepeatedGather(source.detach())(indices(0)).requires_grad


def test_large_tensors_are_freed_at_once() -> None:
    source = torch.ones(3, 12, requires_grad=True)
    gc.disable()
    try:
        images = source * 2
        seen = weakref.ref(images)
        gather = RepeatedGather(images)
        gather(indices(0)).sum().backward()  # type: ignore[no-untyped-call]
        del images, gather
        assert seen() is None
    finally:
        gc.enable()
