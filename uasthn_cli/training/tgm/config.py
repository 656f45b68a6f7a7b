"""Length, pace and size of one run of ``uasthn tgm train``, and the presets."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from uasthn_cli.training.tgm.generators import GeneratorArchitecture

_PAPER_EPOCHS: Final = 200


class Preset(StrEnum):
    """``paper-tgm``: pix2pix as published; ``laptop``: a quarter as wide, 8000 steps."""

    PAPER = "paper-tgm"
    LAPTOP = "laptop"


@dataclass(frozen=True, slots=True)
class TgmConfig:
    """How a generator is trained; the defaults are those that pix2pix was published with.

    Pairs are drawn at ``size_px + jitter_px`` and cropped to ``size_px``. ``learning_rate`` is
    held for half of the steps and then falls to zero. ``discriminator_width`` is the number of
    channels next to the image.
    """

    steps: int
    batch: int = 1
    learning_rate: float = 2e-4
    betas: tuple[float, float] = (0.5, 0.999)
    l1_weight: float = 100.0
    size_px: int = 256
    jitter_px: int = 30
    seed: int = 0
    device: str = "cpu"
    checkpoint_every: int = 500
    architecture: GeneratorArchitecture = field(default_factory=GeneratorArchitecture)
    discriminator_width: int = 64


@dataclass(frozen=True, slots=True)
class _PresetSize:
    steps: int | None
    width: int


_SIZES: Final = {
    Preset.PAPER: _PresetSize(None, 64),
    Preset.LAPTOP: _PresetSize(8000, 16),
}


def preset_width(preset: Preset) -> int:
    """Return the channels next to the image, of generator and discriminator."""
    return _SIZES[preset].width


def preset_steps(preset: Preset, pairs: int, batch: int) -> int:
    """Return the steps of a preset: the published 200 passes over all pairs, or a fixed number.

    The paper cites its thermal generation without numbers; 200 passes (100 at the full rate, 100
    falling) are those of pix2pix's authors.
    """
    steps = _SIZES[preset].steps
    return _PAPER_EPOCHS * math.ceil(pairs / batch) if steps is None else steps
