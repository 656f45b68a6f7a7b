"""A model in training: made anew or taken from a checkpoint, and written to one."""

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import nn

from uasthn_cli.config import TrainingDefaults
from uasthn_cli.errors import TrainingDataError
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.memory import keep_freed_memory
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_weights import load_xcorr
from uasthn_cli.training.checkpoint import (
    XCORR_OPTIONS,
    TrainingState,
    changes_on_resume,
    load_checkpoint,
    require_same_run,
    save_checkpoint,
)
from uasthn_cli.training.samples import SampleConfig

_log = logging.getLogger(__name__)

_DEFAULTS = TrainingDefaults()

ModelT = TypeVar("ModelT", bound=nn.Module)


@dataclass(frozen=True, slots=True)
class TrainingConfig:
    """Length, pace and seed of a run; ``learning_rate`` is held and then falls to zero."""

    steps: int = _DEFAULTS.steps
    learning_rate: float = _DEFAULTS.learning_rate
    weight_decay: float = 1e-3
    gradient_clip: float = 1.0
    seed: int = _DEFAULTS.seed
    device: str = "cpu"
    bfloat16: bool = True
    workers: int = _DEFAULTS.workers
    checkpoint_every: int = _DEFAULTS.checkpoint_every
    samples: SampleConfig = field(default_factory=SampleConfig)
    architecture: XcorrArchitecture = field(default_factory=XcorrArchitecture)


@dataclass(frozen=True, slots=True)
class InitialWeights:
    """Weights that training starts from instead of random ones, and the file they come from."""

    name: str
    sha256: str
    model: XcorrModel


def read_initial_weights(path: Path) -> InitialWeights:
    """Read what training is to start from.

    Raises:
        WeightsError: missing, not safetensors, or of another kind of network.
    """
    model = load_xcorr(path).model
    return InitialWeights(path.name, hashlib.sha256(path.read_bytes()).hexdigest(), model)


@dataclass(slots=True)
class Trainee(Generic[ModelT]):
    """A model in training, the optimiser that moves it, and how many steps it has taken.

    ``settings`` is what its checkpoints say of the run.
    """

    model: ModelT
    optimiser: torch.optim.Optimizer
    step: int
    settings: dict[str, Any]

    @property
    def changes(self) -> list[str]:
        """Settings that were changed on the way, as sentences."""
        return list(self.settings["changes"])


def open_trainee(
    config: TrainingConfig,
    checkpoint_path: Path,
    data: str,
    initial: InitialWeights | None = None,
    teacher: InitialWeights | None = None,
) -> Trainee[XcorrModel]:
    """Return the model in the checkpoint, or a new one with random or ``initial`` weights.

    ``data`` is the scenes' fingerprint; ``initial`` has the architecture of ``config``. A network
    that learns from a ``teacher`` starts with its temperature.

    Raises:
        TrainingDataError: the checkpoint belongs to another run.
    """
    keep_freed_memory()
    torch.manual_seed(config.seed)
    model = XcorrModel(config.architecture)
    if initial is not None:
        model.load_state_dict(initial.model.state_dict())
    elif teacher is not None:
        model.log_temperature.data.copy_(teacher.model.log_temperature.data)
    model.to(config.device)
    use_fast_layout(model)
    optimiser = torch.optim.AdamW(
        model.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
    )
    begun_from = initial.sha256 if initial is not None else ""
    learns_from = teacher.sha256 if teacher is not None else ""
    settings = {
        **asdict(config),
        "data": data,
        "initial": begun_from,
        "teacher": learns_from,
        "changes": [],
    }
    trainee = Trainee(model, optimiser, 0, settings)
    if checkpoint_path.exists():
        resume(trainee, checkpoint_path)
    return trainee


def use_fast_layout(model: nn.Module) -> None:
    """Store convolutions' weights channels last: oneDNN trains several times faster so."""
    for parameter in model.parameters():
        if parameter.ndim == 4:
            parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)


def save_trainee(trainee: Trainee[ModelT], path: Path) -> None:
    """Write a checkpoint.

    Raises:
        OutputError: it cannot be written; the one before stays.
    """
    state = TrainingState(
        trainee.step, trainee.model.state_dict(), trainee.optimiser.state_dict(), trainee.settings
    )
    save_checkpoint(path, state)


def resume(
    trainee: Trainee[ModelT], path: Path, written_as: Mapping[str, str] = XCORR_OPTIONS
) -> None:
    """Take over model, optimiser, step and history of a checkpoint.

    ``written_as`` gives settings the names of the command's options.

    Raises:
        TrainingDataError: the checkpoint belongs to another run.
    """
    state = load_checkpoint(path)
    require_same_run(path, state.settings, trainee.settings, written_as)
    if state.step > trainee.settings["steps"]:
        raise TrainingDataError(
            f"{path}: already at step {state.step}; give --steps of at least that, or another --out"
        )
    try:
        trainee.model.load_state_dict(state.model)
        trainee.optimiser.load_state_dict(state.optimiser)
    except (RuntimeError, ValueError, TypeError, KeyError) as error:
        raise TrainingDataError(f"{path}: of another architecture; choose another --out") from error
    trainee.step = state.step
    trainee.settings["changes"] = changes_on_resume(state.step, state.settings, trainee.settings)
    _log.info("%s: going on from step %d", path, state.step)
