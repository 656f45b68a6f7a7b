"""Displacement networks before training, and after it."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import torch
from torch import nn

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.displacement.checkpoints import load_displacement
from uasthn_cli.matching.displacement.dhn import DhnArchitecture, DirectHomographyNetwork
from uasthn_cli.matching.displacement.ihn import IhnArchitecture, IterativeHomographyNetwork
from uasthn_cli.matching.displacement.model import DisplacementModel, ModelSettings
from uasthn_cli.matching.displacement.sthn import SECOND_STAGE_LEVELS, TwoStageHomographyNetwork
from uasthn_cli.training.displacement.config import (
    PAPER_SATELLITE_PX,
    DisplacementConfig,
    NetworkName,
)

_BEGINS_FROM: Final[Mapping[NetworkName, tuple[str, ...]]] = {
    "dhn": ("dhn",),
    "ihn": ("ihn", "sthn"),
    "sthn": ("sthn", "ihn"),
}
"""Whose weights a network can begin with: the first stage of sthn is an ihn."""


@dataclass(frozen=True, slots=True)
class InitialModel:
    """Weights that training starts from instead of random ones, and the file they come from."""

    name: str
    sha256: str
    model: DisplacementModel


def read_initial_model(path: Path, network: NetworkName) -> InitialModel:
    """Read what a network's training is to start from, in any layout that estimators read.

    Raises:
        WeightsError: missing, unreadable, or of a network that has no stage in common.
    """
    model = load_displacement(path)
    if model.name not in _BEGINS_FROM[network]:
        raise WeightsError(f"{path}: weights of {model.name} are no beginning for {network}")
    digest = hashlib.sha256()
    for name, value in sorted(model.tensors().items()):  # a folder has no bytes of its own
        digest.update(name.encode())
        digest.update(value.numpy().tobytes())
    return InitialModel(path.name, digest.hexdigest(), model)


def build_network(config: DisplacementConfig, initial: InitialModel | None = None) -> nn.Module:
    """Return a network with random weights of the seed, or with ``initial`` ones where it has any.

    Its size is the published one, or that of the initial weights.
    """
    torch.manual_seed(config.seed)
    first = None if initial is None else initial.model.network
    has_head = config.direct_modeling
    if config.network == "dhn":
        return _direct(first, has_head)
    coarse = _stage(first, IhnArchitecture(has_uncertainty_head=has_head))
    if config.network == "ihn":
        return coarse
    second = None if initial is None else initial.model.second
    fine = _stage(second, IhnArchitecture(levels=SECOND_STAGE_LEVELS))
    both = TwoStageHomographyNetwork(coarse.architecture, fine.architecture)
    both.netG.load_state_dict(coarse.state_dict())
    both.netG_fine.load_state_dict(fine.state_dict())
    return both


def trained_model(
    network: nn.Module, config: DisplacementConfig, notes: Mapping[str, str]
) -> DisplacementModel:
    """Return what a weights file should hold of a trained network."""
    settings = ModelSettings(
        width_ratio=config.width_ratio,
        iterations=config.iterations,
        second_iterations=config.fine_iterations,
        box_padding=0.5 * config.box_expansion_px / PAPER_SATELLITE_PX,
    )
    if isinstance(network, TwoStageHomographyNetwork):
        return DisplacementModel(network.netG, network.netG_fine, settings, notes)
    assert isinstance(network, DirectHomographyNetwork | IterativeHomographyNetwork)
    return DisplacementModel(network, None, settings, notes)


def _direct(initial: nn.Module | None, has_head: bool) -> DirectHomographyNetwork:
    """Return a DHN, with a second head or without one."""
    known = initial if isinstance(initial, DirectHomographyNetwork) else None
    size = DhnArchitecture() if known is None else known.architecture
    network = DirectHomographyNetwork(replace(size, has_uncertainty_head=has_head))
    if known is not None:
        _take_over(network, known)
    return network


def _stage(initial: nn.Module | None, published: IhnArchitecture) -> IterativeHomographyNetwork:
    """Return a stage with a second head where ``published`` has one."""
    if not isinstance(initial, IterativeHomographyNetwork):
        return IterativeHomographyNetwork(published)
    has_head = published.has_uncertainty_head
    stage = IterativeHomographyNetwork(replace(initial.architecture, has_uncertainty_head=has_head))
    _take_over(stage, initial)
    return stage


def _take_over(network: nn.Module, initial: nn.Module) -> None:
    """Give a network initial weights; a new head keeps its random ones, one too many is left."""
    own, known = network.state_dict(), initial.state_dict()
    network.load_state_dict({name: known.get(name, value) for name, value in own.items()})
