"""How well a frame fits the map when it is turned and scaled, in feature space.

A correlation is blind to a few degrees and a few per cent, yet its peak is highest where both are
right. The frame's features are turned and scaled as hypothesised, each is correlated with the map
around the frame, and the best score of each tells how likely it is.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from uasthn_cli.matching.correlate import correlate_directly, normalise_template
from uasthn_cli.matching.shift_scores import Encoded
from uasthn_cli.seam import Similarity
from uasthn_cli.types import BoolArray, FloatArray, ImageArray

_WHOLE = 0.999
_PLANES_AT_ONCE = 4
"""OpenCV turns so many planes at once in hardly more time than one."""

_HYPOTHESES_AT_ONCE = 8
"""Templates of all would be the largest thing in memory."""

_NEIGHBOURHOOD = (3, 3)
"""Interpolation smooths, and smooth features correlate better: this levels the ground."""


class TurnedFrame:
    """Scores hypotheses about one frame in one small window; see :data:`uasthn_cli.seam.FitScores`.

    Frame and window are encoded once, however often hypotheses are asked for.
    """

    def __init__(self, members: Sequence[Encoded], mask: ImageArray, near: BoolArray) -> None:
        """Keep a window just large enough for the shifts ``near`` ``(rows, columns)``.

        Those where ``near`` holds count; ``mask`` ``(h, w)`` is the frame's.
        """
        self._members, self._mask, self._near = members, mask, near

    def __call__(self, hypotheses: Sequence[Similarity]) -> FloatArray:
        """Return the best score ``(n,)`` of each hypothesis."""
        parts = range(0, len(hypotheses), _HYPOTHESES_AT_ONCE)
        return np.concatenate(
            [self._best(hypotheses[first : first + _HYPOTHESES_AT_ONCE]) for first in parts]
        )

    def _best(self, hypotheses: Sequence[Similarity]) -> FloatArray:
        scores = []
        for one in self._members:
            turned, masks = turned_features(one.frame, self._mask, hypotheses)
            templates = _templates(turned, masks)
            found = correlate_directly(one.window, templates, masks)
            scores.append(found * np.float32(one.temperature))
        averaged = np.asarray(np.mean(scores, axis=0, dtype=np.float64))
        best: FloatArray = averaged[:, self._near].max(axis=1)
        return best


def _templates(turned: ImageArray, masks: ImageArray) -> ImageArray:
    """Return each hypothesis's features ``(n, C, h, w)`` as a template under its own mask."""
    return np.concatenate(
        [
            normalise_template(features, mask[None])
            for features, mask in zip(turned, masks, strict=True)
        ]
    )


def turned_features(
    features: ImageArray, mask: ImageArray, hypotheses: Sequence[Similarity]
) -> tuple[ImageArray, ImageArray]:
    """Return features turned clockwise and enlarged about their middle, and their masks.

    ``features`` ``(C, h, w)``, ``mask`` ``(h, w)``; results ``(n, C, h, w)``, ``(n, h, w)``.
    """
    height, width = mask.shape
    smooth = [cv2.blur(plane, _NEIGHBOURHOOD, borderType=cv2.BORDER_CONSTANT) for plane in features]
    planes = [*smooth, mask]
    stacks = [
        np.dstack(planes[k : k + _PLANES_AT_ONCE]) for k in range(0, len(planes), _PLANES_AT_ONCE)
    ]
    turned = np.empty((len(hypotheses), len(planes), height, width), np.float32)
    flags = cv2.WARP_INVERSE_MAP | cv2.INTER_LINEAR
    for result, hypothesis in zip(turned, hypotheses, strict=True):
        source = _source(hypothesis, width, height)
        for k, stack in enumerate(stacks):
            warped = cv2.warpAffine(stack, source, (width, height), flags=flags)
            warped = warped.reshape(height, width, -1).transpose(2, 0, 1)
            result[k * _PLANES_AT_ONCE : k * _PLANES_AT_ONCE + len(warped)] = warped
    return turned[:, :-1], (turned[:, -1] > _WHOLE).astype(np.float32)


def _source(hypothesis: Similarity, width: int, height: int) -> FloatArray:
    """Return the affine map ``(2, 3)`` from a turned cell to the one it shows."""
    cosine = math.cos(hypothesis.yaw_rad) / hypothesis.scale
    sine = math.sin(hypothesis.yaw_rad) / hypothesis.scale
    turn = np.array([[cosine, sine], [-sine, cosine]])
    middle = np.array([width - 1, height - 1]) / 2
    return np.column_stack([turn, middle - turn @ middle])
