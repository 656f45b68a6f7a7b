"""Masked, normalised cross-correlation of feature maps by FFT, with gradients.

What :mod:`uasthn_cli.matching.correlate` computes without them.

Only shifts that keep the thermal canvas inside the window are scored, so a circular transform of
the window's own size (or the next one that the FFT likes) is exact.
"""

from typing import Any

import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from scipy.fft import next_fast_len
from torch import Tensor

from uasthn_cli.matching.correlate import ENERGY_EPSILON, NORM_EPSILON


def cell_mask(valid: Tensor, stride_px: int) -> Tensor:
    """Return ``(..., h / stride, w / stride)``: 1 where every pixel of a cell is valid."""
    pooled: Tensor = F.avg_pool2d(valid.float(), stride_px, stride_px)
    return (pooled > 0.999).float()


def normalise_template(features: Tensor, mask: Tensor) -> Tensor:
    """Return thermal features of zero mean per channel and unit norm under a mask.

    ``features`` ``(B, C, h, w)``, ``mask`` ``(B, 1, h, w)``; zero outside the mask.
    """
    count = mask.sum(dim=(2, 3), keepdim=True).clamp_min(1.0)
    centred = (features - (features * mask).sum(dim=(2, 3), keepdim=True) / count) * mask
    norm = centred.flatten(1).norm(dim=1)[:, None, None, None]
    normalised: Tensor = centred / (norm + NORM_EPSILON)
    return normalised


def correlate(window: Tensor, template: Tensor, mask: Tensor) -> Tensor:
    """Return the normalised correlation of templates at every shift inside their window.

    ``window`` ``(B, C, H, W)``; ``template`` ``(B, K, C, h, w)`` from :func:`normalise_template`,
    ``mask`` ``(B, K, 1, h, w)``. Result ``(B, K, H - h + 1, W - w + 1)`` in about -1..1: the score
    of the template's cell (0, 0) lying on each window cell.
    """
    size = _fast_size(window)
    rows, columns = (n - m + 1 for n, m in zip(window.shape[-2:], template.shape[-2:], strict=True))
    response: Tensor = _Correlation.apply(window, template)  # type: ignore[no-untyped-call]
    energy_spectrum = torch.fft.rfft2((window**2).sum(dim=1), s=size)
    mask_spectrum = torch.fft.rfft2(mask[:, :, 0], s=size)
    energy = torch.fft.irfft2(energy_spectrum[:, None] * mask_spectrum.conj(), s=size)
    scores: Tensor = response / torch.sqrt(
        energy[..., :rows, :columns].clamp_min(0) + ENERGY_EPSILON
    )
    return scores


class _Correlation(torch.autograd.Function):
    """Circular cross-correlation summed over channels.

    PyTorch differentiates a real transform through complex ones, at twice the cost; both gradients
    of a correlation are themselves real correlations.
    """

    @staticmethod
    def forward(ctx: Any, window: Tensor, template: Tensor) -> Tensor:
        size, shape = _fast_size(window), window.shape[-2:]
        window_spectrum = torch.fft.rfft2(window, s=size)
        template_spectrum = torch.fft.rfft2(template, s=size)
        ctx.save_for_backward(window_spectrum, template_spectrum)
        ctx.size, ctx.window_shape, ctx.template_shape = size, shape, template.shape[-2:]
        product = (window_spectrum[:, None] * template_spectrum.conj()).sum(dim=2)
        rows, columns = (n - m + 1 for n, m in zip(shape, ctx.template_shape, strict=True))
        response: Tensor = torch.fft.irfft2(product, s=size)[..., :rows, :columns]
        return response

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor]:
        window_spectrum, template_spectrum = ctx.saved_tensors
        spectrum = torch.fft.rfft2(gradient, s=ctx.size)[:, :, None]
        to_window = torch.fft.irfft2((spectrum * template_spectrum).sum(dim=1), s=ctx.size)
        height, width = ctx.window_shape
        to_template = torch.fft.irfft2(spectrum.conj() * window_spectrum[:, None], s=ctx.size)
        rows, columns = ctx.template_shape
        return to_window[..., :height, :width], to_template[..., :rows, :columns]


def _fast_size(window: Tensor) -> tuple[int, int]:
    """Return the smallest transform size that holds the window and has small prime factors."""
    height, width = window.shape[-2:]
    return next_fast_len(height, real=True), next_fast_len(width, real=True)
