"""Data and model uncertainty of one frame, and the two merged (paper, sec. III-B and III-C).

Answers of a frame come as ``(..., M, V, 4, 2)``: the full frame's corners as each of M ensemble
members saw them through each of V views; view 0 is the full frame, member 0 the base network. What
was not asked (only the base network sees the crops) is NaN.
"""

import numpy as np

from uasthn_cli.config import Aggregation, Merge
from uasthn_cli.types import FloatArray


def crop_std(answers: FloatArray) -> FloatArray:
    """Return the deviation ``(..., 4, 2)`` of the base network's views: data uncertainty (eq. 6).

    Unbiased, as in :func:`uasthn_cli.uncertainty.consensus.spread_of_frame`; 0 of a single view.
    """
    return _std(answers[..., 0, :, :, :])


def ensemble_std(answers: FloatArray) -> FloatArray:
    """Return the deviation ``(..., 4, 2)`` of the members on the full frame (eq. 10)."""
    return _std(answers[..., :, 0, :, :])


def merged_std(crops: FloatArray, ensemble: FloatArray, merge: Merge) -> FloatArray:
    """Return the total uncertainty of each corner coordinate (eq. 12); any equal shapes."""
    if merge is Merge.ADD:
        return crops + ensemble
    return np.maximum(crops, ensemble) if merge is Merge.MAX else np.minimum(crops, ensemble)


def crop_corners(answers: FloatArray, aggregation: Aggregation) -> FloatArray:
    """Return the base network's answer ``(..., 4, 2)``: the full frame's, or its views' mean."""
    return _aggregated(answers[..., 0, :, :, :], aggregation)


def ensemble_corners(answers: FloatArray, aggregation: Aggregation) -> FloatArray:
    """Return the answer for the full frame ``(..., 4, 2)``: the base network's, or the mean."""
    return _aggregated(answers[..., :, 0, :, :], aggregation)


def _std(samples: FloatArray) -> FloatArray:
    """Return the unbiased deviation over the third axis from the end."""
    if samples.shape[-3] < 2:
        return np.zeros((*samples.shape[:-3], 4, 2))
    return np.asarray(samples.std(axis=-3, ddof=1))


def _aggregated(samples: FloatArray, aggregation: Aggregation) -> FloatArray:
    """Return the first sample of the third axis from the end, or the mean along it."""
    if aggregation is Aggregation.MEAN:
        return np.asarray(samples.mean(axis=-3))
    return samples[..., 0, :, :]
