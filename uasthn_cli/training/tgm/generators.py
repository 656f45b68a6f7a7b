"""Generators of pix2pix: satellite colours in, thermal grey out.

U-Net and its widths: Isola et al., Image-to-Image Translation with Conditional Adversarial
Networks, CVPR 2017 (arXiv 1611.07004), appendix 6.1. ResNet: Johnson et al., Perceptual Losses for
Real-Time Style Transfer, ECCV 2016, with nine blocks as in CycleGAN. Instance norm stands where
they have batch norm, which at the published batch of one is the same.
"""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Final

import torch
from torch import Tensor, nn

_DROPOUT: Final = 0.5
_DROPOUT_BLOCKS: Final = 3
_MOST_DOUBLINGS: Final = 3
_INITIAL_DEVIATION: Final = 0.02
_SMALLEST_PX: Final = 8


class GeneratorKind(StrEnum):
    """Which network draws: a U-Net (published) or a ResNet."""

    UNET = "unet"
    RESNET = "resnet"


@dataclass(frozen=True, slots=True)
class GeneratorArchitecture:
    """Size of a generator; stored with the weights.

    ``width`` is the number of channels next to the image, ``levels`` how often the U-Net halves
    the image, ``blocks`` how many residual blocks the ResNet has.
    """

    kind: GeneratorKind = GeneratorKind.UNET
    width: int = 64
    levels: int = 8
    blocks: int = 9

    @property
    def stride_px(self) -> int:
        """Sizes of images are multiples of this."""
        return int(2**self.levels) if self.kind is GeneratorKind.UNET else 4

    @property
    def smallest_px(self) -> int:
        """The smallest image: norms and mirrored edges need more than one pixel at any level."""
        return max(self.stride_px, _SMALLEST_PX)

    def as_metadata(self) -> dict[str, object]:
        """Return a JSON-ready description."""
        return asdict(self)


class UnetGenerator(nn.Module):
    """Halve ``levels`` times, double as often, each level seeing the one it came from."""

    def __init__(self, architecture: GeneratorArchitecture) -> None:
        """Build an untrained U-Net."""
        super().__init__()
        levels = architecture.levels
        widths = [architecture.width * 2 ** min(k, _MOST_DOUBLINGS) for k in range(levels)]
        before = [3, *widths]
        # the innermost level may be one pixel, which no norm survives
        self.down = nn.ModuleList(
            _halving(before[k], widths[k], first=k == 0, norm=0 < k < levels - 1)
            for k in range(levels)
        )
        self.up = nn.ModuleList()
        for k in reversed(range(levels)):
            wide = widths[k] if k == levels - 1 else 2 * widths[k]
            dropout = levels - 1 - k < _DROPOUT_BLOCKS
            self.up.append(
                _doubling(wide, widths[k - 1], dropout=dropout) if k else _last_doubling(wide)
            )

    def forward(self, rgb: Tensor) -> Tensor:
        """``(B, 3, H, W)`` to ``(B, 1, H, W)``, both -1..1; H, W multiples of ``2 ** levels``."""
        seen = []
        x = rgb
        for halve in self.down:
            x = halve(x)
            seen.append(x)
        seen.pop()
        for double in self.up:
            x = double(x)
            if seen:
                x = torch.cat([x, seen.pop()], dim=1)
        return x


class ResnetGenerator(nn.Sequential):
    """Quarter the image, transform it in residual blocks, enlarge it again."""

    def __init__(self, architecture: GeneratorArchitecture) -> None:
        """Build an untrained ResNet; it maps ``(B, 3, H, W)`` to ``(B, 1, H, W)``, both -1..1."""
        w = architecture.width
        super().__init__(
            *_reflected(3, w, 7),
            *_normalised(nn.Conv2d(w, 2 * w, 3, 2, 1, bias=False), 2 * w),
            *_normalised(nn.Conv2d(2 * w, 4 * w, 3, 2, 1, bias=False), 4 * w),
            *(_ResidualBlock(4 * w) for _ in range(architecture.blocks)),
            *_normalised(nn.ConvTranspose2d(4 * w, 2 * w, 3, 2, 1, 1, bias=False), 2 * w),
            *_normalised(nn.ConvTranspose2d(2 * w, w, 3, 2, 1, 1, bias=False), w),
            nn.ReflectionPad2d(3),
            nn.Conv2d(w, 1, 7),
            nn.Tanh(),
        )


class _ResidualBlock(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            *_reflected(channels, channels, 3), *_reflected(channels, channels, 3)[:-1]
        )

    def forward(self, x: Tensor) -> Tensor:
        changed: Tensor = x + self.body(x)
        return changed


def build_generator(architecture: GeneratorArchitecture) -> nn.Module:
    """Return an untrained generator with the published initial weights."""
    if architecture.kind is GeneratorKind.UNET:
        return initialised(UnetGenerator(architecture))
    return initialised(ResnetGenerator(architecture))


def initialised(network: nn.Module) -> nn.Module:
    """Draw a network's weights as pix2pix does: normal, deviation 0.02; return it."""
    for module in network.modules():
        if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
            nn.init.normal_(module.weight, 0.0, _INITIAL_DEVIATION)
        elif isinstance(module, nn.InstanceNorm2d):
            nn.init.normal_(module.weight, 1.0, _INITIAL_DEVIATION)
        bias = getattr(module, "bias", None)
        if isinstance(bias, Tensor):
            nn.init.zeros_(bias)
    return network


def instance_norm(channels: int) -> nn.InstanceNorm2d:
    """Return a norm with its own gain and offset, as batch norm has."""
    return nn.InstanceNorm2d(channels, affine=True)


def _halving(channels_in: int, channels_out: int, *, first: bool, norm: bool) -> nn.Sequential:
    """Return [LeakyReLU,] convolution [, norm] from one level of the U-Net to the next."""
    layers: list[nn.Module] = [] if first else [nn.LeakyReLU(0.2)]
    layers.append(nn.Conv2d(channels_in, channels_out, 4, 2, 1, bias=not norm))
    if norm:
        layers.append(instance_norm(channels_out))
    return nn.Sequential(*layers)


def _doubling(channels_in: int, channels_out: int, *, dropout: bool) -> nn.Sequential:
    layers: list[nn.Module] = [
        nn.ReLU(),
        nn.ConvTranspose2d(channels_in, channels_out, 4, 2, 1, bias=False),
        instance_norm(channels_out),
    ]
    if dropout:
        layers.append(nn.Dropout(_DROPOUT))
    return nn.Sequential(*layers)


def _last_doubling(channels_in: int) -> nn.Sequential:
    return nn.Sequential(nn.ReLU(), nn.ConvTranspose2d(channels_in, 1, 4, 2, 1), nn.Tanh())


def _reflected(channels_in: int, channels_out: int, size: int) -> list[nn.Module]:
    """Return a convolution that sees the image mirrored beyond its edges, norm and ReLU."""
    convolution = nn.Conv2d(channels_in, channels_out, size, bias=False)
    return [nn.ReflectionPad2d(size // 2), *_normalised(convolution, channels_out)]


def _normalised(convolution: nn.Module, channels: int) -> list[nn.Module]:
    return [convolution, instance_norm(channels), nn.ReLU()]
