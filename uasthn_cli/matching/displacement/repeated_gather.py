"""Gather from one large tensor many times, and sum the gradients in one place."""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable


class RepeatedGather:
    """``images.gather(1, index)`` for ``images`` ``(n, m)``, called once for every iteration.

    Autograd would make a tensor as large as the images for every call's gradient and add them up:
    for correlation volumes that is most of a training step's traffic. Here all calls add what they
    touched to one buffer, in single precision.
    """

    def __init__(self, images: Tensor) -> None:
        """Gather from these images."""
        self._images, self._sum = images, _Sum()
        self._needs_gradient = images.requires_grad and torch.is_grad_enabled()
        if self._needs_gradient:
            self._images = images.detach()
            self._token = _Whole.apply(images, self._sum)  # type: ignore[no-untyped-call]

    def __call__(self, index: Tensor) -> Tensor:
        """Return values ``(n, k)`` at ``index`` ``(n, k)``."""
        if not self._needs_gradient:
            return self._images.gather(1, index)
        part: Tensor = _Part.apply(  # type: ignore[no-untyped-call]
            self._token, self._images, index, self._sum
        )
        return part


class _Sum:
    """A sum of gradients; the graph holds it, and it holds nothing of the graph."""

    def __init__(self) -> None:
        self.buffer: Tensor | None = None


class _Whole(torch.autograd.Function):
    """Stands for the images; its backward pass runs when all parts have run theirs."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, total: _Sum) -> Tensor:
        ctx.total, ctx.dtype = total, images.dtype
        return images.new_zeros(())

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, _: Tensor) -> tuple[Tensor | None, None]:
        total, ctx.total.buffer = ctx.total.buffer, None
        return None if total is None else total.to(ctx.dtype), None


class _Part(torch.autograd.Function):
    """One call; to autograd it depends on the images' stand-in alone."""

    @staticmethod
    def forward(ctx: Any, token: Tensor, images: Tensor, index: Tensor, total: _Sum) -> Tensor:
        ctx.save_for_backward(index)
        ctx.total, ctx.shape, ctx.dtype = total, images.shape, token.dtype
        return images.gather(1, index)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None, None]:
        (index,) = ctx.saved_tensors
        exact = torch.promote_types(gradient.dtype, torch.float32)
        if ctx.total.buffer is None:
            ctx.total.buffer = gradient.new_zeros(ctx.shape, dtype=exact)
        ctx.total.buffer.scatter_add_(1, index, gradient.to(exact))
        return gradient.new_zeros((), dtype=ctx.dtype), None, None, None
