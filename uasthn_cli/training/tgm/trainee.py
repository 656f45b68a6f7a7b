"""Generator and discriminator in training: made anew or taken from a checkpoint."""

import logging
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import torch
from torch import nn

from uasthn_cli.errors import TrainingDataError
from uasthn_cli.matching.memory import keep_freed_memory
from uasthn_cli.training.checkpoint import (
    TrainingState,
    changes_on_resume,
    load_checkpoint,
    require_same_run,
    save_checkpoint,
)
from uasthn_cli.training.tgm.config import TgmConfig
from uasthn_cli.training.tgm.discriminator import PatchDiscriminator
from uasthn_cli.training.tgm.generators import build_generator

_log = logging.getLogger(__name__)

_WRITTEN_AS: Final = {
    "data": "data set (or its files have changed)",
    "batch": "--batch",
    "seed": "--seed",
    "architecture.kind": "--generator",
    "architecture.width": "--width or --preset",
    "discriminator_width": "--width or --preset",
}


@dataclass(slots=True)
class TgmTrainee:
    """Both networks, the optimisers that move them, and how many steps they have taken.

    ``settings`` is what their checkpoints say of the run.
    """

    generator: nn.Module
    discriminator: PatchDiscriminator
    generator_optimiser: torch.optim.Optimizer
    discriminator_optimiser: torch.optim.Optimizer
    step: int
    settings: dict[str, Any]

    @property
    def changes(self) -> list[str]:
        """Settings that were changed on the way, as sentences."""
        return list(self.settings["changes"])


def open_tgm_trainee(config: TgmConfig, checkpoint_path: Path, data: str) -> TgmTrainee:
    """Return the networks in the checkpoint, or new ones; ``data`` is the pairs' fingerprint.

    Raises:
        TrainingDataError: the checkpoint belongs to another run.
    """
    keep_freed_memory()
    torch.manual_seed(config.seed)
    generator = build_generator(config.architecture).to(config.device)
    discriminator = PatchDiscriminator(config.discriminator_width).to(config.device)

    def adam(network: nn.Module) -> torch.optim.Optimizer:
        return torch.optim.Adam(network.parameters(), lr=config.learning_rate, betas=config.betas)

    settings = {**asdict(config), "data": data, "changes": []}
    settings["architecture"]["kind"] = str(config.architecture.kind)  # a checkpoint holds no enum
    trainee = TgmTrainee(
        generator, discriminator, adam(generator), adam(discriminator), 0, settings
    )
    if checkpoint_path.exists():
        _resume(trainee, checkpoint_path)
    return trainee


def save_tgm_trainee(trainee: TgmTrainee, path: Path) -> None:
    """Write a checkpoint.

    Raises:
        OutputError: it cannot be written; the one before stays.
    """
    model = {
        "generator": trainee.generator.state_dict(),
        "discriminator": trainee.discriminator.state_dict(),
    }
    optimiser = {
        "generator": trainee.generator_optimiser.state_dict(),
        "discriminator": trainee.discriminator_optimiser.state_dict(),
    }
    save_checkpoint(path, TrainingState(trainee.step, model, optimiser, trainee.settings))


def _resume(trainee: TgmTrainee, path: Path) -> None:
    """Take over networks, optimisers, step and history of a checkpoint."""
    state = load_checkpoint(path)
    require_same_run(path, state.settings, trainee.settings, _WRITTEN_AS)
    if state.step > trainee.settings["steps"]:
        raise TrainingDataError(
            f"{path}: already at step {state.step}; give --steps of at least that, or another --out"
        )
    try:
        trainee.generator.load_state_dict(state.model["generator"])
        trainee.discriminator.load_state_dict(state.model["discriminator"])
        trainee.generator_optimiser.load_state_dict(state.optimiser["generator"])
        trainee.discriminator_optimiser.load_state_dict(state.optimiser["discriminator"])
    except (RuntimeError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise TrainingDataError(f"{path}: of another network; choose another --out") from error
    trainee.step = state.step
    trainee.settings["changes"] = changes_on_resume(state.step, state.settings, trainee.settings)
    _log.info("%s: going on from step %d", path, state.step)
