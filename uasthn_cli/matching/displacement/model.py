"""A displacement network with all that is needed to use it: what a weights file holds."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from torch import Tensor

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.matching.displacement.dhn import DhnArchitecture, DirectHomographyNetwork
from uasthn_cli.matching.displacement.ihn import (
    ITERATIONS,
    IhnArchitecture,
    IterativeHomographyNetwork,
)
from uasthn_cli.matching.displacement.sthn import BOX_PADDING

FIRST_STAGE, SECOND_STAGE = "netG", "netG_fine"
"""What the authors call them, and the prefixes of tensors' names in all layouts."""

NAMES = ("dhn", "ihn", "sthn")

WIDTH_RATIO = 3.0
"""Paper: satellite images of 1,536 m for thermal ones of 512 m."""


@dataclass(frozen=True, slots=True)
class ModelSettings:
    """How a network was trained to be used.

    ``width_ratio`` is the satellite image's width divided by the thermal image's, both before they
    are resized: regressed displacements hold for that ratio alone. ``box_padding`` is a share of
    the satellite image's width.
    """

    width_ratio: float = WIDTH_RATIO
    iterations: int = ITERATIONS
    second_iterations: int = ITERATIONS
    box_padding: float = BOX_PADDING

    def as_metadata(self) -> dict[str, Any]:
        """Return the settings as JSON can hold them."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class DisplacementModel:
    """A first stage, for STHN a second one, and how to use them; ``notes`` come from training."""

    network: DirectHomographyNetwork | IterativeHomographyNetwork
    second: IterativeHomographyNetwork | None = None
    settings: ModelSettings = ModelSettings()
    notes: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The estimator's name: ``dhn``, ``ihn`` or ``sthn``."""
        if isinstance(self.network, DirectHomographyNetwork):
            return "dhn"
        return "ihn" if self.second is None else "sthn"

    def architecture(self) -> dict[str, Any]:
        """Return stages and settings as JSON can hold them."""
        stages = {FIRST_STAGE: self.network.architecture.as_metadata()}
        if self.second is not None:
            stages[SECOND_STAGE] = self.second.architecture.as_metadata()
        return {**stages, "settings": self.settings.as_metadata()}

    def tensors(self) -> dict[str, Tensor]:
        """Return all weights by name, each stage's under its prefix."""
        stages = {FIRST_STAGE: self.network, SECOND_STAGE: self.second}
        return {
            f"{prefix}.{name}": value.detach().cpu().contiguous()
            for prefix, stage in stages.items()
            if stage is not None
            for name, value in stage.state_dict().items()
        }


def model_of(
    name: str, architecture: Mapping[str, Any], notes: Mapping[str, str]
) -> DisplacementModel:
    """Build a model with random weights from :meth:`DisplacementModel.architecture`.

    Raises:
        KeyError, TypeError, ValueError: the description does not describe one.
    """
    settings = ModelSettings(**architecture["settings"])
    stage = dict(architecture[FIRST_STAGE])
    if name == "dhn":
        w1, w2, w3, w4, w5 = stage.pop("widths")
        size = DhnArchitecture((w1, w2, w3, w4, w5), **stage)
        return DisplacementModel(DirectHomographyNetwork(size), None, settings, notes)
    second = _ihn(architecture[SECOND_STAGE]) if name == "sthn" else None
    return DisplacementModel(_ihn(stage), second, settings, notes)


def _ihn(stage: Mapping[str, Any]) -> IterativeHomographyNetwork:
    first, second = stage["block_widths"]
    return IterativeHomographyNetwork(
        IhnArchitecture(**{**stage, "block_widths": (int(first), int(second))})
    )


def authors_config(model: DisplacementModel) -> dict[str, Any]:
    """Return what the authors' ``config.json`` says of a model, for a map of 1,536 pixels."""
    width_px = round(model.settings.width_ratio * 512)
    levels = getattr(model.network.architecture, "levels", None)
    return {
        "resize_width": RESIZED_WIDTH_PX,
        "database_size": width_px,
        "corr_level": levels,
        "iters_lev0": model.settings.iterations,
        "iters_lev1": model.settings.second_iterations,
        "fine_padding": round(model.settings.box_padding * width_px),
    }
