"""Dense feature encoders of the learned cross-correlation, and the model that holds both."""

import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor, nn

from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.normalise import satellite_input, thermal_input


class ConvolutionBlock(nn.Sequential):
    """Convolution, batch norm (foldable: its statistics do not depend on the window), ReLU."""

    def __init__(
        self, channels_in: int, channels_out: int, *, stride: int = 1, size: int = 3
    ) -> None:
        """Keep the image size divided by ``stride``."""
        super().__init__(
            nn.Conv2d(channels_in, channels_out, size, stride, size // 2, bias=False),
            nn.BatchNorm2d(channels_out),
            nn.ReLU(inplace=True),
        )


class ResidualBlock(nn.Module):
    """Two convolutions around an identity."""

    def __init__(self, channels: int) -> None:
        """Keep size and channels."""
        super().__init__()
        self.first = ConvolutionBlock(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, x: Tensor) -> Tensor:
        """``(B, C, h, w)`` to the same."""
        return F.relu(x + self.second(self.first(x)))


class Encoder(nn.Module):
    """A small U-Net: image ``(B, channels_in, H, W)`` to features ``(B, C, H / 2, W / 2)``."""

    def __init__(self, channels_in: int, architecture: XcorrArchitecture) -> None:
        """Build four levels at 1/2, 1/4, 1/8 and 1/16 of the image."""
        super().__init__()
        w1, w2, w3, w4 = architecture.widths
        self.stem = nn.Sequential(
            ConvolutionBlock(channels_in, w1, stride=2, size=5), ConvolutionBlock(w1, w1)
        )
        self.down2 = nn.Sequential(ConvolutionBlock(w1, w2, stride=2), ResidualBlock(w2))
        self.down3 = nn.Sequential(ConvolutionBlock(w2, w3, stride=2), ResidualBlock(w3))
        self.down4 = nn.Sequential(
            ConvolutionBlock(w3, w4, stride=2), ResidualBlock(w4), ResidualBlock(w4)
        )
        self.lateral3, self.up3 = nn.Conv2d(w4, w3, 1), ResidualBlock(w3)
        self.lateral2, self.up2 = nn.Conv2d(w3, w2, 1), ResidualBlock(w2)
        self.lateral1, self.up1 = nn.Conv2d(w2, w1, 1), ConvolutionBlock(w1, w1)
        self.head = nn.Conv2d(w1, architecture.feature_channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, channels_in, H, W)`` to ``(B, C, H / 2, W / 2)``; H, W multiples of 16."""
        level1 = self.stem(x)
        level2 = self.down2(level1)
        level3 = self.down3(level2)
        level4 = self.down4(level3)
        level3 = self.up3(level3 + _enlarge(self.lateral3(level4)))
        level2 = self.up2(level2 + _enlarge(self.lateral2(level3)))
        level1 = self.up1(level1 + _enlarge(self.lateral1(level2)))
        features: Tensor = self.head(level1)
        return features


class XcorrModel(nn.Module):
    """Encoders of map and thermal image into one feature space.

    ``log_temperature`` sharpens the search's posterior.
    """

    def __init__(self, architecture: XcorrArchitecture | None = None) -> None:
        """Build untrained encoders."""
        super().__init__()
        self.architecture = architecture or XcorrArchitecture()
        self.satellite_encoder = Encoder(6, self.architecture)
        self.thermal_encoder = Encoder(2, self.architecture)
        self.log_temperature = nn.Parameter(torch.tensor(3.0))

    def encode_satellite(
        self, rgb: Tensor, valid: Tensor, mean: Tensor, deviation: Tensor
    ) -> Tensor:
        """``(B, 3, H, W)``, ``(B, 1, H, W)``, ``(B, 3)``, ``(B,)`` to ``(B, C, H/2, W/2)``."""
        features: Tensor = self.satellite_encoder(satellite_input(rgb, valid, mean, deviation))
        return features

    def encode_thermal(self, thermal: Tensor, valid: Tensor) -> Tensor:
        """``(B, 1, h, w)`` image and mask to ``(B, C, h / 2, w / 2)``."""
        features: Tensor = self.thermal_encoder(thermal_input(thermal, valid))
        return features


def _enlarge(x: Tensor) -> Tensor:
    return F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
