"""Brightness and edges, beside the learned features: a second opinion on where a frame lies.

Learned features find a frame where nothing else does, but they are made to distrust brightness, and
so place it less finely than plain correlation does wherever brightness can be trusted. Both see the
same shifts, and each says how much it believes in each of them; the beliefs are multiplied. How
much this one counts (:data:`~uasthn_cli.matching.ncc.CELLS_PER_SAMPLE`) was chosen on rendered
flights by the mean log posterior at the true place.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from uasthn_cli.matching.correlate import Kernels
from uasthn_cli.matching.ncc import (
    CELLS_PER_SAMPLE,
    LARGEST_CORRELATION,
    NccChannel,
    channel_image,
)
from uasthn_cli.types import BoolArray, ImageArray

CHANNELS = (NccChannel.GREY, NccChannel.GRADIENT)

_EPSILON = np.float32(1e-6)


def appearance_cells(grey: ImageArray, valid: BoolArray, stride_px: int) -> ImageArray:
    """Return brightness and gradient ``(2, h / stride, w / stride)`` of an image ``(h, w)``."""
    size = (grey.shape[1] // stride_px, grey.shape[0] // stride_px)
    images = [channel_image(grey, valid, channel) for channel in CHANNELS]
    cells = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
    return np.stack(cells).astype(np.float32)


def levelled_window(window: ImageArray, valid: BoolArray) -> ImageArray:
    """Return map cells ``(2, H, W)`` less their mean, as which those that are not valid count."""
    inside = valid.astype(np.float32)
    count = np.float32(max(float(inside.sum()), 1.0))
    mean = (window * inside).sum(axis=(1, 2), keepdims=True) / count
    levelled: ImageArray = (window - mean) * inside
    return levelled


@dataclass(frozen=True, slots=True)
class AppearanceKernels:
    """A frame's brightness and gradient under N masks: of no mean, with its norm and the cells."""

    kernels: Kernels
    norm: ImageArray
    covered: ImageArray


def appearance_kernels(template: ImageArray, masks: ImageArray) -> AppearanceKernels:
    """Return what is compared of a frame.

    ``template`` ``(2, h, w)`` from :func:`appearance_cells`, ``masks`` ``(N, h, w)`` in {0, 1}.
    """
    covered = np.maximum(masks.sum(axis=(1, 2)), 1.0)[:, None, None, None]
    means = (template * masks[:, None]).sum(axis=(2, 3), keepdims=True) / covered
    centred = (template - means) * masks[:, None]
    norm = np.sqrt((centred**2).sum(axis=(2, 3)))[..., None, None]
    kernels = Kernels(np.concatenate([centred, masks[:, None]], axis=1))
    return AppearanceKernels(kernels, norm, covered)


def appearance_scores(levelled: ImageArray, frame: AppearanceKernels) -> ImageArray:
    """Return the log-likelihood ``(N, rows, columns)`` of every shift, its sign ignored.

    ``levelled`` ``(2, H, W)`` from :func:`levelled_window`. Night inverts contrast as it likes, so
    only the square of the correlation counts; brightness and gradient count as independent.
    """
    correlation = masked_correlation(levelled, frame)
    squared = np.minimum(np.abs(correlation), np.float32(LARGEST_CORRELATION)) ** 2
    samples = frame.covered[:, 0] / np.float32(CELLS_PER_SAMPLE)
    scores: ImageArray = np.float32(-0.5) * samples * np.log1p(-squared).sum(axis=1)
    return scores


def masked_correlation(levelled: ImageArray, frame: AppearanceKernels) -> ImageArray:
    """Return Pearson's correlation ``(N, C, rows, columns)`` under each mask at every shift."""
    channels = len(levelled)
    planes = np.concatenate([levelled, levelled**2])
    single = [slice(plane, plane + 1) for plane in range(2 * channels)]
    responses = [(channel, channel) for channel in single[:channels]]
    under_mask = [(plane, single[channels]) for plane in single]
    sums = frame.kernels.sums(planes, [*responses, *under_mask])
    response, total, squares = np.split(sums, 3, axis=1)
    spread = np.maximum(squares - total**2 / frame.covered, _EPSILON * frame.covered)
    correlation: ImageArray = response / np.maximum(frame.norm * np.sqrt(spread), _EPSILON)
    return correlation
