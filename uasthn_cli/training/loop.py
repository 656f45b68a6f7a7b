"""Train the learned cross-correlation: batches in, losses out, a checkpoint behind every step."""

import ctypes
import logging
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.utils.data import DataLoader

from uasthn_cli.errors import TrainingDataError
from uasthn_cli.matching.networks import XcorrArchitecture, XcorrModel
from uasthn_cli.training.checkpoint import TrainingState, load_checkpoint, save_checkpoint
from uasthn_cli.training.losses import search_loss, search_scores
from uasthn_cli.training.samples import CANVAS_PX, Batch, SampleConfig, SampleDataset
from uasthn_cli.training.scenes import SceneSet

_log = logging.getLogger(__name__)

_WARM_UP_STEPS = 100
_DECAY_SHARE = 0.3
_VALIDATION_SEED_OFFSET = 1_000_003
_VALIDATION_BATCHES = 6
_MALLOC_TRIM_THRESHOLD, _MALLOC_MMAP_MAX = -1, -4


@dataclass(frozen=True, slots=True)
class TrainingConfig:
    """Length, pace and seed of a run; ``learning_rate`` is held and then falls to zero."""

    steps: int = 6000
    learning_rate: float = 2e-3
    weight_decay: float = 1e-3
    gradient_clip: float = 1.0
    seed: int = 0
    device: str = "cpu"
    bfloat16: bool = True
    workers: int = 1
    checkpoint_every: int = 50
    samples: SampleConfig = field(default_factory=SampleConfig)
    architecture: XcorrArchitecture = field(default_factory=XcorrArchitecture)


@dataclass(frozen=True, slots=True)
class Progress:
    """Means since the last report: loss, median error and share within 4 px of the best cell."""

    step: int
    seconds: float
    loss: float
    median_error_px: float
    within_4_px: float
    validation_within_4_px: float | None = None


def train(
    scenes: SceneSet, config: TrainingConfig, checkpoint_path: Path
) -> Iterator[tuple[Progress, XcorrModel]]:
    """Train from the last checkpoint, if any, and yield progress with every checkpoint written.

    Batch ``n`` of a seed is the same in every run, so a resumed run equals an unbroken one up to
    the order of floating-point sums.

    Raises:
        TrainingDataError: the checkpoint belongs to another architecture.
    """
    _keep_freed_memory()
    torch.manual_seed(config.seed)
    model = XcorrModel(config.architecture).to(config.device, memory_format=torch.channels_last)
    optimiser = torch.optim.AdamW(
        model.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
    )
    start = _resume(model, optimiser, config, checkpoint_path)
    started = time.monotonic()
    losses: list[float] = []
    errors: list[NDArray[np.float32]] = []
    for step, batch in enumerate(_batches(scenes, config, start), start=start):
        _set_learning_rate(optimiser, config, step)
        loss, error = _step(model, optimiser, batch, config)
        losses.append(loss)
        errors.append(error)
        if (step + 1) % config.checkpoint_every == 0 or step + 1 == config.steps:
            state = TrainingState(
                step + 1, model.state_dict(), optimiser.state_dict(), _settings(config)
            )
            save_checkpoint(checkpoint_path, state)
            seconds, joined = time.monotonic() - started, np.concatenate(errors)
            within, median = float(np.mean(joined < 4)), float(np.median(joined))
            yield (
                Progress(step + 1, seconds, float(np.mean(losses)), median, within),
                model,
            )
            losses, errors = [], []


def validate(model: XcorrModel, scenes: SceneSet, config: TrainingConfig) -> tuple[float, float]:
    """Return median error and share within 4 px on batches that training never draws."""
    dataset = SampleDataset(
        scenes,
        config.samples,
        seed=config.seed + _VALIDATION_SEED_OFFSET,
        batches=_VALIDATION_BATCHES,
    )
    model.eval()
    errors = []
    with torch.no_grad():
        for index in range(_VALIDATION_BATCHES):
            tensors = _tensors(dataset[index], config.device)
            scores = search_scores(model, *tensors[:4])
            errors.append(search_loss(scores, tensors[4], CANVAS_PX)[1].flatten().cpu().numpy())
    model.train()
    joined = np.concatenate(errors)
    return float(np.median(joined)), float(np.mean(joined < 4))


def learning_rate_at(step: int, config: TrainingConfig) -> float:
    """Return warm-up, plateau, then linear decay over the last 30 % of the steps."""
    warm = min(1.0, (step + 1) / _WARM_UP_STEPS)
    left = (config.steps - step) / max(1.0, _DECAY_SHARE * config.steps)
    return config.learning_rate * min(warm, 1.0, left)


def _batches(scenes: SceneSet, config: TrainingConfig, start: int) -> Iterator[Batch]:
    dataset = SampleDataset(scenes, config.samples, seed=config.seed, batches=config.steps)
    loader: DataLoader[Batch] = DataLoader(
        dataset,
        batch_size=None,
        sampler=range(start, config.steps),
        num_workers=config.workers,
        collate_fn=_identity,
        prefetch_factor=4 if config.workers else None,
    )
    return iter(loader)


def _identity(batch: Batch) -> Batch:
    return batch


def _tensors(batch: Batch, device: str) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    satellite, satellite_valid, thermal, valid, corners = (
        torch.from_numpy(array).to(device)
        for array in (
            batch.satellite,
            batch.satellite_valid,
            batch.thermal,
            batch.thermal_valid,
            batch.corners_px,
        )
    )
    return satellite, satellite_valid, thermal, valid, corners


def _step(
    model: XcorrModel, optimiser: torch.optim.Optimizer, batch: Batch, config: TrainingConfig
) -> tuple[float, NDArray[np.float32]]:
    tensors = _tensors(batch, config.device)
    device_type = torch.device(config.device).type
    with torch.autocast(device_type, torch.bfloat16, enabled=config.bfloat16):
        scores = search_scores(model, *tensors[:4])
    loss, error = search_loss(scores, tensors[4], CANVAS_PX)
    optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    nn.utils.clip_grad_norm_(model.parameters(), config.gradient_clip)
    optimiser.step()
    return float(loss.item()), error.flatten().cpu().numpy()


def _set_learning_rate(optimiser: torch.optim.Optimizer, config: TrainingConfig, step: int) -> None:
    for group in optimiser.param_groups:
        group["lr"] = learning_rate_at(step, config)


def _resume(
    model: XcorrModel, optimiser: torch.optim.Optimizer, config: TrainingConfig, path: Path
) -> int:
    if not path.exists():
        return 0
    state = load_checkpoint(path)
    try:
        model.load_state_dict(state.model)
        optimiser.load_state_dict(state.optimiser)
    except (RuntimeError, ValueError) as error:
        raise TrainingDataError(
            f"{path}: checkpoint of another architecture; choose another --out"
        ) from error
    _log.info("%s: going on from step %d", path, state.step)
    return state.step


def _settings(config: TrainingConfig) -> dict[str, Any]:
    return asdict(config)


def _keep_freed_memory() -> None:
    """Tell glibc to reuse large freed blocks: page faults otherwise take half of a CPU step."""
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except OSError:
        return
    mallopt(_MALLOC_MMAP_MAX, 0)
    mallopt(_MALLOC_TRIM_THRESHOLD, 2**31 - 1)
