"""Save and resume a training run: model, optimiser and step, whole or not at all."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from uasthn_cli.errors import TrainingDataError


@dataclass(frozen=True, slots=True)
class TrainingState:
    """What a killed run needs to go on as if nothing had happened."""

    step: int
    model: dict[str, Any]
    optimiser: dict[str, Any]
    settings: dict[str, Any]


def save_checkpoint(path: Path, state: TrainingState) -> None:
    """Write a checkpoint through a temporary file and a rename."""
    temporary = path.with_name(path.name + ".tmp")
    content = {
        "step": state.step,
        "model": state.model,
        "optimiser": state.optimiser,
        "settings": state.settings,
    }
    torch.save(content, temporary)
    os.replace(temporary, path)


def load_checkpoint(path: Path) -> TrainingState:
    """Read a checkpoint without running any code in it.

    Raises:
        TrainingDataError: the file is not a checkpoint of this tool.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        return TrainingState(
            int(content["step"]), content["model"], content["optimiser"], content["settings"]
        )
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, EOFError) as error:
        raise TrainingDataError(
            f"{path}: not a checkpoint to resume from ({error}); delete it to start anew"
        ) from error
