"""Brightness and edges, beside the learned features: a second opinion on where a frame lies.

Learned features find a frame where nothing else does, but they are made to distrust brightness, and
so place it less finely than plain correlation does wherever brightness can be trusted. Both see the
same shifts, and each says how much it believes in each of them; the beliefs are multiplied. How
much this one counts (:data:`~uasthn_cli.matching.ncc.CELLS_PER_SAMPLE`) was chosen on rendered
flights by the mean log posterior at the true place.
"""

import cv2
import numpy as np
import torch
from torch import Tensor

from uasthn_cli.matching.ncc import (
    CELLS_PER_SAMPLE,
    LARGEST_CORRELATION,
    NccChannel,
    channel_image,
)
from uasthn_cli.types import BoolArray, ImageArray

CHANNELS = (NccChannel.GREY, NccChannel.GRADIENT)

_EPSILON = 1e-6


def appearance_cells(grey: ImageArray, valid: BoolArray, stride_px: int) -> ImageArray:
    """Return brightness and gradient ``(2, h / stride, w / stride)`` of an image ``(h, w)``."""
    size = (grey.shape[1] // stride_px, grey.shape[0] // stride_px)
    images = [channel_image(grey, valid, channel) for channel in CHANNELS]
    cells = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
    return np.stack(cells).astype(np.float32)


def appearance_scores(window: Tensor, valid: Tensor, template: Tensor, masks: Tensor) -> Tensor:
    """Return the log-likelihood ``(N, rows, columns)`` of every shift, its sign ignored.

    ``window`` ``(2, H, W)`` and ``template`` ``(2, h, w)`` from :func:`appearance_cells`, ``valid``
    ``(H, W)`` and ``masks`` ``(N, h, w)`` in {0, 1}. Night inverts contrast as it likes, so only
    the square of the correlation counts; brightness and gradient count as independent.
    """
    correlation = masked_correlation(window, valid, template, masks)
    squared = correlation.clamp(-LARGEST_CORRELATION, LARGEST_CORRELATION) ** 2
    samples = masks.sum(dim=(1, 2))[:, None, None] / CELLS_PER_SAMPLE
    scores: Tensor = -0.5 * samples * torch.log1p(-squared).sum(dim=1)
    return scores


def masked_correlation(window: Tensor, valid: Tensor, template: Tensor, masks: Tensor) -> Tensor:
    """Return Pearson's correlation ``(N, C, rows, columns)`` under each mask at every shift.

    Cells of the window that are not valid count as its mean.
    """
    count = valid.sum().clamp_min(1.0)
    window = (window - (window * valid).sum(dim=(1, 2), keepdim=True) / count) * valid
    covered = masks.sum(dim=(1, 2))[:, None, None, None].clamp_min(1.0)
    means = (template * masks[:, None]).sum(dim=(2, 3), keepdim=True) / covered
    centred = (template - means) * masks[:, None]
    norm = centred.flatten(2).norm(dim=2)[..., None, None]
    size = window.shape[-2:]
    spectrum = torch.fft.rfft2(window)
    mask_spectrum = torch.fft.rfft2(masks, s=size).conj()[:, None]

    def at_every_shift(product: Tensor) -> Tensor:
        rows, columns = (n - m + 1 for n, m in zip(size, masks.shape[-2:], strict=True))
        shifted: Tensor = torch.fft.irfft2(product, s=size)[..., :rows, :columns]
        return shifted

    response = at_every_shift(spectrum * torch.fft.rfft2(centred, s=size).conj())
    total = at_every_shift(spectrum * mask_spectrum)
    squares = at_every_shift(torch.fft.rfft2(window**2) * mask_spectrum)
    spread = (squares - total**2 / covered).clamp_min(_EPSILON * covered)
    correlation: Tensor = response / (norm * spread.sqrt()).clamp_min(_EPSILON)
    return correlation
