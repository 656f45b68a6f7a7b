"""The patch discriminator of pix2pix: is each 70 x 70 patch of this pair real?"""

import torch
from torch import Tensor, nn

from uasthn_cli.training.tgm.generators import initialised, instance_norm

PATCH_PX = 70
"""What one cell of the answer has seen (Isola et al. 2017, appendix 6.1.2)."""


class PatchDiscriminator(nn.Module):
    """C64-C128-C256-C512 over satellite and thermal image together."""

    def __init__(self, width: int) -> None:
        """Build an untrained discriminator; ``width`` is 64 as published."""
        super().__init__()
        w = width
        self.layers = nn.Sequential(
            nn.Conv2d(4, w, 4, 2, 1),
            nn.LeakyReLU(0.2),
            *_block(w, 2 * w, stride=2),
            *_block(2 * w, 4 * w, stride=2),
            *_block(4 * w, 8 * w, stride=1),
            nn.Conv2d(8 * w, 1, 4, 1, 1),
        )
        initialised(self)

    def forward(self, rgb: Tensor, thermal: Tensor) -> Tensor:
        """``(B, 3, H, W)`` and ``(B, 1, H, W)`` to logits ``(B, 1, H / 8 - 2, W / 8 - 2)``."""
        logits: Tensor = self.layers(torch.cat([rgb, thermal], dim=1))
        return logits


def _block(channels_in: int, channels_out: int, *, stride: int) -> list[nn.Module]:
    convolution = nn.Conv2d(channels_in, channels_out, 4, stride, 1, bias=False)
    return [convolution, instance_norm(channels_out), nn.LeakyReLU(0.2)]
