"""Masked input normalisation: what both encoders see of an image.

Every image goes in twice: normalised by its local mean and contrast (small structures survive any
exposure), and by the mean and deviation of the whole map or frame (large structures survive, which
local normalisation throws away).
"""

import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor

from uasthn_cli.matching.architecture import (
    LOCAL_WINDOW_PX,
    POOL_PX,
    SATELLITE_EPSILON,
    THERMAL_EPSILON,
)


def local_mean(image: Tensor, valid: Tensor, window_px: int = LOCAL_WINDOW_PX) -> Tensor:
    """Return the mean of the valid pixels around each pixel.

    ``image`` ``(B, C, H, W)``, ``valid`` ``(B, 1, H, W)`` in 0..1; a box of about ``window_px``
    computed on an eightfold reduced image, so it is cheap and the same in every map tile.
    """
    reach = max(1, window_px // POOL_PX // 2)
    stacked = torch.cat([image * valid, valid], dim=1)
    reduced = F.avg_pool2d(stacked, POOL_PX, POOL_PX, ceil_mode=True)
    summed = F.avg_pool2d(reduced, 2 * reach + 1, 1, reach)
    smooth = F.interpolate(summed, size=image.shape[-2:], mode="bilinear", align_corners=False)
    return smooth[:, :-1] / smooth[:, -1:].clamp_min(1e-3)


def local_contrast(image: Tensor, valid: Tensor, epsilon: float) -> Tensor:
    """Return ``image`` minus its local mean, over its local deviation; 0 where not valid."""
    centred = (image - local_mean(image, valid)) * valid
    variance = local_mean((centred * centred).mean(dim=1, keepdim=True), valid)
    normalised: Tensor = centred / torch.sqrt(variance.clamp_min(0) + epsilon)
    return normalised


def satellite_input(rgb: Tensor, valid: Tensor, mean: Tensor, deviation: Tensor) -> Tensor:
    """Return the satellite encoder's input ``(B, 6, H, W)``.

    ``rgb`` ``(B, 3, H, W)`` in 0..1, ``valid`` ``(B, 1, H, W)``, ``mean`` ``(B, 3)`` and
    ``deviation`` ``(B,)`` of the whole map.
    """
    large = (rgb - mean[:, :, None, None]) / (deviation[:, None, None, None] + 1e-2) * valid
    return torch.cat([local_contrast(rgb, valid, SATELLITE_EPSILON), large], dim=1)


def thermal_input(thermal: Tensor, valid: Tensor) -> Tensor:
    """Return the thermal encoder's input ``(B, 2, h, w)`` of ``thermal`` ``(B, 1, h, w)``."""
    count = valid.sum(dim=(2, 3), keepdim=True).clamp_min(1.0)
    centred = (thermal - (thermal * valid).sum(dim=(2, 3), keepdim=True) / count) * valid
    deviation = torch.sqrt((centred * centred).sum(dim=(2, 3), keepdim=True) / count)
    large = centred / (deviation + 1e-3)
    return torch.cat([local_contrast(large, valid, THERMAL_EPSILON), large], dim=1)
