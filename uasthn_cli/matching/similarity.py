"""How well a frame fits the map when it is turned and scaled, in feature space.

A correlation is blind to a few degrees and a few per cent, yet its peak is highest where both are
right. The frame's features are turned and scaled as hypothesised, each is correlated with the map
around the frame, and the best score of each tells how likely it is.
"""

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor

from uasthn_cli.seam import Similarity


def turned_features(
    features: Tensor, mask: Tensor, hypotheses: Sequence[Similarity]
) -> tuple[Tensor, Tensor]:
    """Return features turned clockwise and enlarged about their middle, and their masks.

    ``features`` ``(C, h, w)``, ``mask`` ``(1, h, w)``; results ``(n, C, h, w)``, ``(n, 1, h, w)``.
    """
    height, width = features.shape[-2:]
    y, x = torch.meshgrid(
        torch.arange(height, device=features.device) - (height - 1) / 2,
        torch.arange(width, device=features.device) - (width - 1) / 2,
        indexing="ij",
    )
    grids = []
    for hypothesis in hypotheses:
        cosine = math.cos(hypothesis.yaw_rad) / hypothesis.scale
        sine = math.sin(hypothesis.yaw_rad) / hypothesis.scale
        source_x, source_y = cosine * x + sine * y, cosine * y - sine * x
        grids.append(torch.stack([source_x * (2 / width), source_y * (2 / height)], dim=-1))
    grid = torch.stack(grids).to(features)
    # interpolation smooths, and smooth features correlate better: level the ground beforehand
    smooth = F.avg_pool2d(features[None], 3, 1, 1)[0]
    stacked = torch.cat([smooth, mask]).expand(len(grid), -1, -1, -1)
    turned = F.grid_sample(stacked, grid, align_corners=False)
    masks = (turned[:, -1:] > 0.999).to(features)
    return turned[:, :-1], masks
