"""How a displacement network is trained, and the presets."""

from dataclasses import dataclass
from typing import Final, Literal

from uasthn_cli.config import CROP_OFFSET_FRACTION, PAPER_THERMAL_PX

NetworkName = Literal["dhn", "ihn", "sthn"]
FirstStage = Literal["joint", "frozen"]

LEARNING_RATE: Final = 1e-4
"""The paper's largest."""

PAPER_SATELLITE_PX: Final = 1536
"""W_S of the paper at its 1 m a pixel: the width at which boxes of the second stage are stated."""


@dataclass(frozen=True, slots=True)
class DisplacementConfig:
    """Losses, length and pace of a run; the defaults are the paper's (sec. IV).

    ``width_ratio`` is how much wider a satellite image is than a thermal one: displacements hold
    for one ratio alone, so satellite images are cut or padded to it. ``tgm_share`` is how much of
    what is learnt from a thermal generator draws, where there is one. The first ``plain_steps`` see
    whole thermal images only, the others ``views`` (N_C) of each, the whole image among them; in
    both parts the learning rate falls linearly to zero. The paper states no batch size and no
    weight decay. ``first_stage`` and the boxes are of ``sthn``: edges of the first stage's bounding
    box move by up to ``box_augmentation_px`` in training, and the box is ``box_expansion_px`` wider
    in use, both of 1536 px.
    """

    network: NetworkName
    steps: int
    batch: int = 16
    tgm_share: float = 0.0
    width_ratio: float = PAPER_SATELLITE_PX / PAPER_THERMAL_PX
    plain_steps: int = 0
    views: int = 1
    crop_offset_fraction: float = CROP_OFFSET_FRACTION
    direct_modeling: bool = False
    iterations: int = 6
    fine_iterations: int = 6
    decay: float = 0.85
    learning_rate: float = LEARNING_RATE
    weight_decay: float = 1e-4
    gradient_clip: float = 1.0
    first_stage: FirstStage = "joint"
    fine_satellite_px: int = PAPER_SATELLITE_PX
    box_augmentation_px: float = 64.0
    box_expansion_px: float = 64.0
    seed: int = 0
    device: str = "cpu"
    bfloat16: bool = False
    workers: int = 1
    checkpoint_every: int = 50

    def __post_init__(self) -> None:
        """Refuse what makes no sense together.

        Raises:
            ValueError: it does not, and why.
        """
        if self.direct_modeling and self.views > 1:
            raise ValueError(
                "Direct Modeling and crops are two ways to the same uncertainty, and the paper"
                " defines no loss for both: choose one"
            )
        if self.first_stage == "frozen" and self.network != "sthn":
            raise ValueError(f"{self.network} has but one stage: nothing to freeze")

    def views_at(self, step: int) -> int:
        """Return how many views of each thermal image a step sees, counted from 0."""
        return 1 if step < self.plain_steps else self.views

    def learning_rate_at(self, step: int) -> float:
        """Return the rate of a step: a linear decay before the crops, another one with them."""
        first, last = (0, self.plain_steps) if step < self.plain_steps else (self.plain_steps, None)
        end = self.steps if last is None else min(last, self.steps)
        return self.learning_rate * max(0.0, 1.0 - (step - first) / max(1, end - first))


@dataclass(frozen=True, slots=True)
class Preset:
    """Length and size of a run; ``network`` None: of any.

    The first ``plain_share`` of the steps is without crops.
    """

    network: NetworkName | None
    steps: int
    batch: int
    views: int
    plain_share: float = 1 / 3
    fine_satellite_px: int = PAPER_SATELLITE_PX


PRESETS: Final = {
    "paper-dhn": Preset("dhn", 300_000, 16, 5),
    "paper-ihn": Preset("ihn", 300_000, 16, 5),
    "paper-sthn": Preset("sthn", 300_000, 16, 5),
    "laptop": Preset(None, 200, 2, 3, plain_share=2 / 3, fine_satellite_px=768),
}
"""``paper-…``: 100k steps, then 200k with crops (paper, sec. IV); ``laptop``: minutes on two cores.

The paper states no batch size.
"""
