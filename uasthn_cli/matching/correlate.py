"""Masked, normalised cross-correlation of feature maps at every shift, by FFT.

A large window is cut into overlapping blocks (overlap-save), so that the cost grows with the number
of shifts and no transform outgrows the processor's cache.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from uasthn_cli.types import BoolArray, ImageArray

ENERGY_EPSILON = 1e-3
"""Added to the window's energy under a template: where there is hardly any, nothing correlates."""

NORM_EPSILON = 1e-4
"""Added to a template's norm."""

_LARGEST_BLOCK = 320
"""Cells: 24 transforms of twice this side take four times as long a cell."""

Planes = slice | int
"""Which planes of a stack take part."""


def cell_mask(valid: BoolArray, stride_px: int) -> BoolArray:
    """Return ``(h / stride, w / stride)``: true where every pixel of a cell is valid."""
    rows, columns = valid.shape[0] // stride_px, valid.shape[1] // stride_px
    blocks = valid[: rows * stride_px, : columns * stride_px]
    cells = blocks.reshape(rows, stride_px, columns, stride_px)
    return np.asarray(np.logical_and.reduce(cells, axis=(1, 3)), np.bool_)


def normalise_template(features: ImageArray, masks: ImageArray) -> ImageArray:
    """Return features ``(C, h, w)`` under N masks ``(N, h, w)`` as templates ``(N, C, h, w)``.

    Of zero mean per channel and unit norm under each mask, zero outside.
    """
    inside = masks[:, None]
    count = np.maximum(masks.sum(axis=(1, 2)), 1.0)[:, None, None, None]
    centred = (features - (features * inside).sum(axis=(2, 3), keepdims=True) / count) * inside
    norm = np.sqrt((centred**2).sum(axis=(1, 2, 3)))[:, None, None, None]
    normalised: ImageArray = (centred / (norm + NORM_EPSILON)).astype(np.float32)
    return normalised


def correlate(window: ImageArray, templates: ImageArray, masks: ImageArray) -> ImageArray:
    """Return the normalised correlation ``(N, rows, columns)`` at every shift inside the window.

    ``window`` ``(C, H, W)``; ``templates`` ``(N, C, h, w)`` of :func:`normalise_template` under
    ``masks`` ``(N, h, w)``. In about -1..1: the score of the template's cell (0, 0) lying on each
    window cell; ``rows`` is ``H - h + 1``.
    """
    channels = len(window)
    planes = np.concatenate([window, (window**2).sum(axis=0, keepdims=True)])
    kernels = np.concatenate([templates, masks[:, None]], axis=1)
    sums = sliding_sums(planes, kernels, [(slice(channels), slice(channels)), (channels, channels)])
    energy = np.maximum(sums[:, 1], 0) + np.float32(ENERGY_EPSILON)
    return np.asarray(sums[:, 0] / np.sqrt(energy), dtype=np.float32)


def correlate_directly(window: ImageArray, templates: ImageArray, masks: ImageArray) -> ImageArray:
    """Return :func:`correlate`, by matrix products: faster for many templates at few shifts."""
    response = sum(map(_sums_directly, window, templates.swapaxes(0, 1)))
    energy = _sums_directly((window**2).sum(axis=0), masks) + np.float32(ENERGY_EPSILON)
    return np.asarray(response / np.sqrt(energy), dtype=np.float32)


def _sums_directly(plane: ImageArray, kernels: ImageArray) -> ImageArray:
    """Return sums of products of a plane ``(H, W)`` with kernels ``(N, h, w)`` at every shift."""
    pieces = np.lib.stride_tricks.sliding_window_view(plane, kernels.shape[1:])
    rows, columns = pieces.shape[:2]
    sums = kernels.reshape(len(kernels), -1) @ pieces.reshape(rows * columns, -1).T
    return np.asarray(sums.reshape(-1, rows, columns))


def sliding_sums(
    planes: ImageArray, kernels: ImageArray, pairs: Sequence[tuple[Planes, Planes]]
) -> ImageArray:
    """Return sums of products ``(N, S, rows, columns)`` of planes with kernels at every shift.

    ``planes`` ``(P, H, W)``, ``kernels`` ``(N, K, h, w)``. Each of the S ``pairs`` says which
    planes are multiplied with which kernels, one by one, and added up.
    """
    height, width = kernels.shape[-2:]
    rows, columns = planes.shape[-2] - height + 1, planes.shape[-1] - width + 1
    (step_y, size_y), (step_x, size_x) = _block(rows, height), _block(columns, width)
    size = (size_y, size_x)
    # rows of zeros are not transformed one by one, nor rows of which nothing is kept
    conjugate = fft.fft(fft.rfft(kernels, n=size_x), n=size_y, axis=-2, overwrite_x=True)
    np.conjugate(conjugate, out=conjugate)
    products = np.empty((len(kernels), len(pairs), *conjugate.shape[-2:]), np.complex64)
    sums = np.empty((len(kernels), len(pairs), rows, columns), np.float32)
    for y, x in _starts(rows, step_y, columns, step_x):
        spectrum = fft.rfft2(planes[:, y : y + size_y, x : x + size_x], s=size)
        for k, (of_planes, of_kernels) in enumerate(pairs):
            _multiply(spectrum[of_planes], conjugate[:, of_kernels], products[:, k])
        into = sums[..., y : y + step_y, x : x + step_x]
        kept = fft.ifft(products, axis=-2, overwrite_x=True)[..., : into.shape[-2], :]
        into[...] = fft.irfft(kept, n=size_x, overwrite_x=True)[..., : into.shape[-1]]
    return sums


def _multiply(
    planes: NDArray[np.complex64], kernels: NDArray[np.complex64], into: NDArray[np.complex64]
) -> None:
    """Multiply spectra of planes with those of kernels, added up where they are several."""
    if planes.ndim == 2:
        np.multiply(planes, kernels, out=into)
    else:
        np.einsum("chw,nchw->nhw", planes, kernels, out=into)


def _block(shifts: int, kernel: int) -> tuple[int, int]:
    """Return how many shifts a block covers along one axis, and its transform's length."""
    count = max(1, math.ceil(shifts / max(_LARGEST_BLOCK - kernel + 1, kernel)))
    step = math.ceil(shifts / count)
    return step, int(fft.next_fast_len(step + kernel - 1, real=True))


def _starts(rows: int, step_y: int, columns: int, step_x: int) -> Iterator[tuple[int, int]]:
    for y in range(0, rows, step_y):
        for x in range(0, columns, step_x):
            yield y, x
