"""The eight turns and mirror images of a square: one model seen eight ways is a free ensemble.

North-up images have no preferred direction to a matcher, but a convolutional encoder has. Encoding
an image under all eight symmetries, turning the features back and stacking them averages that out.
"""

from collections.abc import Callable

import torch
from torch import Tensor

SYMMETRIES = 8


def encode_symmetric(
    encode: Callable[[Tensor, Tensor], Tensor], image: Tensor, valid: Tensor, symmetries: int
) -> Tensor:
    """Return features of the first ``symmetries`` orientations, turned back, stacked by channel.

    ``image`` ``(B, C, H, W)``, ``valid`` ``(B, 1, H, W)``; ``encode`` maps both to features.
    """
    stacked = []
    for index in range(symmetries):
        turns, mirrored = index % 4, index >= 4
        features = encode(_turn(image, turns, mirrored), _turn(valid, turns, mirrored))
        stacked.append(_turn_back(features, turns, mirrored))
    return torch.cat(stacked, dim=1)


def _turn(x: Tensor, turns: int, mirrored: bool) -> Tensor:
    turned = torch.rot90(x, turns, (2, 3))
    return torch.flip(turned, (3,)) if mirrored else turned


def _turn_back(x: Tensor, turns: int, mirrored: bool) -> Tensor:
    unmirrored = torch.flip(x, (3,)) if mirrored else x
    return torch.rot90(unmirrored, -turns, (2, 3))
