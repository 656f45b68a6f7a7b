"""Train the learned cross-correlation: batches in, losses out, a checkpoint every so often."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from uasthn_cli.errors import TrainingDivergedError
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.training.batches import BatchT, load_batches
from uasthn_cli.training.distil import distillation_loss, reduce_channels
from uasthn_cli.training.losses import encode_batch, scores_of, search_loss, search_scores
from uasthn_cli.training.samples import CANVAS_PX, Batch, SampleDataset
from uasthn_cli.training.scenes import SceneSet
from uasthn_cli.training.trainee import (
    ModelT,
    Trainee,
    TrainingConfig,
    open_trainee,
    save_trainee,
)

_WARM_UP_STEPS = 100
_DECAY_SHARE = 0.3
_VALIDATION_SEED_OFFSET = 1_000_003
_VALIDATION_BATCHES = 6
_REDUCTION_SEED_OFFSET = 2_000_003
_REDUCTION_BATCHES = 12


@dataclass(frozen=True, slots=True)
class Progress:
    """Means since the last report: loss, median error and share within 4 px of the best cell."""

    step: int
    seconds: float
    loss: float
    median_error_px: float
    within_4_px: float


class Validation(NamedTuple):
    """Error of the best cell on held-out batches: median, and share within 4 px."""

    median_error_px: float
    within_4_px: float


class Lesson(NamedTuple):
    """What a batch teaches: the loss, and every answer's error ``(n,)`` in pixels."""

    loss: Tensor
    error_px: NDArray[np.float32]


class Pace(Protocol):
    """Length of a run, and how often it is saved."""

    @property
    def steps(self) -> int:
        """Batches that are learnt from."""

    @property
    def checkpoint_every(self) -> int:
        """Steps between checkpoints."""

    @property
    def gradient_clip(self) -> float:
        """Largest norm of a step's gradient."""


def train(
    scenes: SceneSet, config: TrainingConfig, checkpoint_path: Path
) -> Iterator[tuple[Progress, XcorrModel]]:
    """Train from the last checkpoint, if any, and yield progress with every checkpoint written.

    Raises:
        TrainingDataError: the checkpoint belongs to another run.
        TrainingDivergedError: the loss is no longer finite.
    """
    trainee = open_trainee(config, checkpoint_path, scenes.fingerprint())
    for progress in train_steps(trainee, scenes, config, checkpoint_path):
        yield progress, trainee.model


def train_steps(
    trainee: Trainee[XcorrModel],
    scenes: SceneSet,
    config: TrainingConfig,
    checkpoint_path: Path,
    on_step: Callable[[int], None] = lambda _: None,
    teacher: XcorrModel | None = None,
) -> Iterator[Progress]:
    """Train to the last step; yields after every checkpoint, calls ``on_step`` after every step.

    With a ``teacher`` of as many feature channels, its features are learnt and not the search.

    Batch ``n`` of a seed is the same in every run, and a checkpoint holds all that the next step
    depends on: on a CPU with the same number of threads, a resumed run ends with the same bits as
    an unbroken one.

    Raises:
        TrainingDivergedError: the loss is no longer finite; the last checkpoint stays.
        OutputError: a checkpoint cannot be written.
    """
    return take_steps(
        trainee,
        lambda start: _batches(scenes, config, start),
        lambda batch: _learn(trainee.model, batch, config, teacher),
        lambda step: learning_rate_at(step, config),
        config,
        checkpoint_path,
        on_step,
    )


def take_steps(
    trainee: Trainee[ModelT],
    batches: Callable[[int], Iterator[BatchT]],
    learn: Callable[[BatchT], Lesson],
    learning_rate: Callable[[int], float],
    pace: Pace,
    checkpoint_path: Path,
    on_step: Callable[[int], None],
) -> Iterator[Progress]:
    """Descend along ``learn``'s loss to the last step; yields after every checkpoint.

    ``batches`` yields from the number given on; ``learning_rate`` depends on the step alone.

    Raises:
        TrainingDivergedError: the loss is no longer finite; the last checkpoint stays.
        OutputError: a checkpoint cannot be written.
    """
    if trainee.step >= pace.steps:
        return
    started_s = time.monotonic()
    losses: list[float] = []
    errors: list[NDArray[np.float32]] = []
    for batch in batches(trainee.step):
        for group in trainee.optimiser.param_groups:
            group["lr"] = learning_rate(trainee.step)
        loss, error = learn(batch)
        _descend(trainee, loss, pace.gradient_clip)
        trainee.step += 1
        losses.append(loss.item())
        errors.append(error)
        on_step(trainee.step)
        if trainee.step % pace.checkpoint_every == 0 or trainee.step == pace.steps:
            save_trainee(trainee, checkpoint_path)
            seconds, joined = time.monotonic() - started_s, np.concatenate(errors)
            within, median = float(np.mean(joined < 4)), float(np.median(joined))
            yield Progress(trainee.step, seconds, float(np.mean(losses)), median, within)
            losses, errors = [], []


def validate(model: XcorrModel, scenes: SceneSet, config: TrainingConfig) -> Validation:
    """Return the error on batches, of the same scenes, that training never draws."""
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
    return Validation(float(np.median(joined)), float(np.mean(joined < 4)))


def learning_rate_at(step: int, config: TrainingConfig) -> float:
    """Return warm-up, plateau, then linear decay over the last 30 % of the steps."""
    warm = min(1.0, (step + 1) / _WARM_UP_STEPS)
    left = (config.steps - step) / max(1.0, _DECAY_SHARE * config.steps)
    return config.learning_rate * min(warm, 1.0, left)


def _batches(scenes: SceneSet, config: TrainingConfig, start: int) -> Iterator[Batch]:
    dataset = SampleDataset(scenes, config.samples, seed=config.seed, batches=config.steps)
    return load_batches(dataset, config.workers, start)


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


def reduced_teacher(teacher: XcorrModel, scenes: SceneSet, config: TrainingConfig) -> XcorrModel:
    """Return a teacher with as many feature channels as the network in training has.

    Which of them matter is seen on batches that training never draws.
    """
    channels = config.architecture.feature_channels
    teacher = teacher.eval().to(config.device)
    if teacher.architecture.feature_channels == channels:
        return teacher
    dataset = SampleDataset(
        scenes,
        config.samples,
        seed=config.seed + _REDUCTION_SEED_OFFSET,
        batches=_REDUCTION_BATCHES,
    )
    batches = (_tensors(dataset[index], config.device) for index in range(_REDUCTION_BATCHES))
    return reduce_channels(teacher, batches, channels).eval().to(config.device)


def _learn(
    model: XcorrModel, batch: Batch, config: TrainingConfig, teacher: XcorrModel | None = None
) -> Lesson:
    tensors = _tensors(batch, config.device)
    device_type = torch.device(config.device).type
    with torch.autocast(device_type, torch.bfloat16, enabled=config.bfloat16):
        own = encode_batch(model, *tensors[:4])
        with nullcontext() if teacher is None else torch.no_grad():
            scores = scores_of(model, own, tensors[3])
            shown = None if teacher is None else encode_batch(teacher, *tensors[:4])
    loss, error = search_loss(scores, tensors[4], CANVAS_PX)
    if shown is not None:
        loss, _ = distillation_loss(own, shown)
    return Lesson(loss, error.flatten().cpu().numpy())


def _descend(trainee: Trainee[ModelT], loss: Tensor, gradient_clip: float) -> None:
    if not math.isfinite(loss.item()):
        raise TrainingDivergedError(
            f"the loss is no longer finite at step {trainee.step + 1}; start anew with a smaller"
            " --learning-rate or with --precision float32"
        )
    trainee.optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    nn.utils.clip_grad_norm_(trainee.model.parameters(), gradient_clip)
    trainee.optimiser.step()
