"""Masked, normalised cross-correlation of feature maps at every shift, by FFT.

A large window is cut into overlapping blocks (overlap-save), so that the cost grows with the number
of shifts and no transform outgrows the processor's cache.
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial

import cv2
import numpy as np

from uasthn_cli.types import ImageArray

ENERGY_EPSILON = 1e-3
"""Added to the window's energy under a template: where there is hardly any, nothing correlates."""

NORM_EPSILON = 1e-4
"""Added to a template's norm."""

_LARGEST_BLOCK = 320
"""Cells: 24 transforms of twice this side take four times as long a cell."""

_INVERSE = cv2.DFT_INVERSE | cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT


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


def template_kernels(features: ImageArray, masks: ImageArray) -> "Kernels":
    """Return what :func:`correlate` needs of features ``(C, h, w)`` under masks ``(N, h, w)``."""
    return Kernels(np.concatenate([normalise_template(features, masks), masks[:, None]], axis=1))


def correlate(window: ImageArray, kernels: "Kernels") -> ImageArray:
    """Return the normalised correlation ``(N, rows, columns)`` at every shift inside the window.

    ``window`` ``(C, H, W)``, ``kernels`` of :func:`template_kernels` of size ``(h, w)``. In about
    -1..1: the score of the template's cell (0, 0) lying on each window cell; ``rows`` is
    ``H - h + 1``.
    """
    learned, energy_plane = slice(len(window)), slice(len(window), None)
    planes = np.concatenate([window, (window**2).sum(axis=0, keepdims=True)])
    sums = kernels.sums(planes, [(learned, learned), (energy_plane, energy_plane)])
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


class Kernels:
    """Kernels ``(N, K, h, w)`` to be multiplied with planes at every shift.

    Their spectra are kept for further planes of the same size.
    """

    def __init__(self, kernels: ImageArray) -> None:
        """Transform nothing yet."""
        self._kernels = kernels
        self._size = (0, 0)
        self._spectra: list[list[ImageArray]] = []

    def sums(self, planes: ImageArray, pairs: Sequence[tuple[slice, slice]]) -> ImageArray:
        """Return sums of products ``(N, S, rows, columns)`` of planes with kernels at every shift.

        ``planes`` ``(P, H, W)``. Each of the S ``pairs`` says which planes are multiplied with
        which kernels, one by one, and added up.
        """
        height, width = self._kernels.shape[-2:]
        rows, columns = planes.shape[-2] - height + 1, planes.shape[-1] - width + 1
        (step_y, size_y), (step_x, size_x) = _block(rows, height), _block(columns, width)
        spectra = self._of_size((size_y, size_x))
        sums = np.empty((len(spectra), len(pairs), rows, columns), np.float32)
        for y, x in _starts(rows, step_y, columns, step_x):
            block = planes[:, y : y + size_y, x : x + size_x]
            windows = [_spectrum(plane, (size_y, size_x)) for plane in block]
            for own, into in zip(spectra, sums[..., y : y + step_y, x : x + step_x], strict=True):
                for (of_planes, of_kernels), kept in zip(pairs, into, strict=True):
                    product = _product(windows[of_planes], own[of_kernels])
                    cv2.dft(product, dst=product, flags=_INVERSE, nonzeroRows=kept.shape[0])
                    kept[...] = product[: kept.shape[0], : kept.shape[1]]
        return sums

    def _of_size(self, size: tuple[int, int]) -> list[list[ImageArray]]:
        if size != self._size:
            self._size = size
            self._spectra = [[_spectrum(plane, size) for plane in own] for own in self._kernels]
        return self._spectra


def _spectrum(plane: ImageArray, size: tuple[int, int]) -> ImageArray:
    """Return the spectrum of a plane with zeros below and to its right, in OpenCV's packing."""
    padded = np.zeros(size, np.float32)
    padded[: plane.shape[0], : plane.shape[1]] = plane
    cv2.dft(padded, dst=padded, nonzeroRows=plane.shape[0])
    return padded


def _product(planes: Sequence[ImageArray], kernels: Sequence[ImageArray]) -> ImageArray:
    """Return the spectra of planes times the conjugates of those of kernels, added up."""
    total, *others = map(partial(cv2.mulSpectrums, flags=0, conjB=True), planes, kernels)
    for product in others:
        cv2.add(total, product, dst=total)
    return np.asarray(total)


def _block(shifts: int, kernel: int) -> tuple[int, int]:
    """Return how many shifts a block covers along one axis, and its transform's length."""
    count = max(1, math.ceil(shifts / max(_LARGEST_BLOCK - kernel + 1, kernel)))
    step = math.ceil(shifts / count)
    return step, cv2.getOptimalDFTSize(step + kernel - 1)


def _starts(rows: int, step_y: int, columns: int, step_x: int) -> Iterator[tuple[int, int]]:
    for y in range(0, rows, step_y):
        for x in range(0, columns, step_x):
            yield y, x
