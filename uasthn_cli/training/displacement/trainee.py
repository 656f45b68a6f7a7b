"""A displacement network in training, from its beginning or from a checkpoint."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Final

import torch
from torch import nn

from uasthn_cli.matching.displacement.sthn import TwoStageHomographyNetwork
from uasthn_cli.matching.memory import keep_freed_memory
from uasthn_cli.training.displacement.config import DisplacementConfig
from uasthn_cli.training.trainee import Trainee, resume, use_fast_layout

DISPLACEMENT_OPTIONS: Final = {
    "network": "--network",
    "batch": "--batch",
    "plain_steps": "--plain-steps (by default a share of --steps)",
    "views": "--croptta",
    "crop_offset_fraction": "--crop-offset",
    "direct_modeling": "--dm",
    "learning_rate": "--learning-rate",
    "tgm_share": "--tgm-share",
    "first_stage": "--first-stage",
    "fine_satellite_px": "--preset",
    "seed": "--seed",
    "data": "data set (or its files have changed)",
    "initial": "--init",
    "generator": "--tgm",
}
"""How settings of ``uasthn train`` for displacement networks are typed."""


def open_displacement_trainee(
    network: nn.Module,
    config: DisplacementConfig,
    checkpoint_path: Path,
    origins: Mapping[str, str],
) -> Trainee[nn.Module]:
    """Return the network, or what has become of it in the checkpoint, with its optimiser.

    ``origins`` are digests: ``data`` of what is learnt from, ``initial`` of the weights begun with,
    ``generator`` of what draws thermal images; empty for none.

    Raises:
        TrainingDataError: the checkpoint belongs to another run.
    """
    keep_freed_memory()
    network.to(config.device)
    use_fast_layout(network)
    if config.first_stage == "frozen" and isinstance(network, TwoStageHomographyNetwork):
        network.netG.requires_grad_(False)
    optimiser = torch.optim.AdamW(
        [parameter for parameter in network.parameters() if parameter.requires_grad],
        lr=config.learning_rate,
        weight_decay=config.weight_decay,
    )
    settings = {**asdict(config), **origins, "changes": []}
    trainee = Trainee(network, optimiser, 0, settings)
    if checkpoint_path.exists():
        resume(trainee, checkpoint_path, DISPLACEMENT_OPTIONS)
    return trainee
