"""The eight turns and mirror images of a square: one model seen eight ways is a free ensemble.

North-up images have no preferred direction to a matcher, but a convolutional encoder has. Encoding
an image under all eight symmetries, turning the features back and stacking them averages that out.
"""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.types import BoolArray, ImageArray

SYMMETRIES = 8

_QUARTER_TURNS = (0, 2, 1, 3)
"""Upside down comes second: two opposite orientations cancel an encoder's bias to one side."""

_T = TypeVar("_T", bound=np.generic)


def encode_symmetric(
    encode: Callable[[ImageArray, BoolArray], ImageArray],
    image: ImageArray,
    valid: BoolArray,
    symmetries: int,
) -> ImageArray:
    """Return features of the first ``symmetries`` orientations, turned back, stacked by channel.

    ``image`` ``(…, H, W)``, ``valid`` ``(H, W)``; ``encode`` maps both to features ``(C, h, w)``.
    """
    stacked = []
    for index in range(symmetries):
        turns, mirrored = _QUARTER_TURNS[index % 4], index >= 4
        features = encode(_turn(image, turns, mirrored), _turn(valid, turns, mirrored))
        stacked.append(_turn_back(features, turns, mirrored))
    return np.concatenate(stacked)


def _turn(x: NDArray[_T], turns: int, mirrored: bool) -> NDArray[_T]:
    turned = np.rot90(x, turns, (-2, -1))
    return np.ascontiguousarray(turned[..., ::-1] if mirrored else turned)


def _turn_back(x: NDArray[_T], turns: int, mirrored: bool) -> NDArray[_T]:
    unmirrored = x[..., ::-1] if mirrored else x
    return np.ascontiguousarray(np.rot90(unmirrored, -turns, (-2, -1)))
