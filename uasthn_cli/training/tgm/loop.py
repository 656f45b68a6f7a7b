"""Train a generator against its discriminator: pix2pix, a checkpoint every so often.

Loss, optimiser and schedule: Isola et al., CVPR 2017, sections 3.1 and 3.3: the discriminator
learns with half its loss, the generator with the adversarial loss plus 100 times L1.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor

from uasthn_cli.datasets.samples import MatchDataset
from uasthn_cli.errors import TrainingDivergedError
from uasthn_cli.training.tgm.config import TgmConfig
from uasthn_cli.training.tgm.pairs import (
    PairBatch,
    PairBatches,
    aligned_satellite,
    as_tensor,
    resized_thermal,
)
from uasthn_cli.training.tgm.trainee import TgmTrainee, save_tgm_trainee

GREY_LEVELS_PER_UNIT: Final = 127.5
"""Images are in -1..1 inside, in 0..255 outside."""

_HELD_SHARE: Final = 0.5
_SEED_STRIDE: Final = 1_000_003
_VALIDATION_PAIRS: Final = 64


class Losses(NamedTuple):
    """Of one step: adversarial, discriminator's, and L1 in grey levels of 0..255."""

    adversarial: float
    discriminator: float
    l1_grey: float


@dataclass(frozen=True, slots=True)
class TgmProgress:
    """Mean losses since the last report."""

    step: int
    seconds: float
    losses: Losses


def train_tgm_steps(
    trainee: TgmTrainee,
    dataset: MatchDataset,
    config: TgmConfig,
    checkpoint_path: Path,
    on_step: Callable[[int], None] = lambda _: None,
) -> Iterator[TgmProgress]:
    """Train to the last step; yields after every checkpoint, calls ``on_step`` after every step.

    A checkpoint holds all that the next step depends on: on a CPU with the same number of threads,
    a resumed run ends with the same bits as an unbroken one.

    Raises:
        TrainingDivergedError: a loss is no longer finite; the last checkpoint stays.
        OutputError: a checkpoint cannot be written.
    """
    batches = PairBatches(
        dataset,
        batch=config.batch,
        size_px=config.size_px,
        jitter_px=config.jitter_px,
        seed=config.seed,
    )
    started_s = time.monotonic()
    recent: list[Losses] = []
    trainee.generator.train()
    while trainee.step < config.steps:
        _prepare(trainee, config)
        recent.append(_step(trainee, batches[trainee.step], config))
        trainee.step += 1
        on_step(trainee.step)
        if trainee.step % config.checkpoint_every == 0 or trainee.step == config.steps:
            save_tgm_trainee(trainee, checkpoint_path)
            means = Losses(*(float(mean) for mean in np.mean(recent, axis=0)))
            yield TgmProgress(trainee.step, time.monotonic() - started_s, means)
            recent = []


def validation_l1_grey(trainee: TgmTrainee, dataset: MatchDataset, config: TgmConfig) -> float:
    """Return the mean absolute error, in grey levels, on at most 64 evenly spread pairs."""
    count = min(len(dataset), _VALIDATION_PAIRS)
    trainee.generator.eval()
    errors = []
    with torch.no_grad():
        for index in sorted({int(k) for k in np.linspace(0, len(dataset) - 1, count)}):
            sample = dataset[index]
            satellite = as_tensor(aligned_satellite(sample, config.size_px)[None])
            thermal = as_tensor(resized_thermal(sample.thermal, config.size_px)[None, ..., None])
            drawn = trainee.generator(satellite.to(config.device)).cpu()
            errors.append(float(F.l1_loss(drawn, thermal)) * GREY_LEVELS_PER_UNIT)
    trainee.generator.train()
    return float(np.mean(errors))


def learning_rate_at(step: int, config: TgmConfig) -> float:
    """Return the full rate for the first half of the steps, then a linear fall to zero."""
    left = (config.steps - step) / max(1.0, (1 - _HELD_SHARE) * config.steps)
    return config.learning_rate * min(1.0, left)


def _prepare(trainee: TgmTrainee, config: TgmConfig) -> None:
    """Set what depends on the step alone: dropout's random state and the learning rates."""
    torch.manual_seed(config.seed * _SEED_STRIDE + trainee.step)
    for optimiser in (trainee.generator_optimiser, trainee.discriminator_optimiser):
        for group in optimiser.param_groups:
            group["lr"] = learning_rate_at(trainee.step, config)


def _step(trainee: TgmTrainee, batch: PairBatch, config: TgmConfig) -> Losses:
    satellite, thermal = (images.to(config.device) for images in batch)
    drawn = trainee.generator(satellite)
    discriminator_loss = 0.5 * (
        _verdict_loss(trainee.discriminator(satellite, thermal), is_real=True)
        + _verdict_loss(trainee.discriminator(satellite, drawn.detach()), is_real=False)
    )
    _descend(trainee.discriminator_optimiser, discriminator_loss)
    trainee.discriminator.requires_grad_(False)  # it only passes the gradient on
    adversarial = _verdict_loss(trainee.discriminator(satellite, drawn), is_real=True)
    l1 = F.l1_loss(drawn, thermal)
    _descend(trainee.generator_optimiser, adversarial + config.l1_weight * l1)
    trainee.discriminator.requires_grad_(True)
    losses = Losses(adversarial.item(), discriminator_loss.item(), l1.item() * GREY_LEVELS_PER_UNIT)
    if not all(map(math.isfinite, losses)):
        raise TrainingDivergedError(
            f"a loss is no longer finite at step {trainee.step + 1}; start anew with another --seed"
        )
    return losses


def _verdict_loss(logits: Tensor, *, is_real: bool) -> Tensor:
    target = torch.full_like(logits, float(is_real))
    return F.binary_cross_entropy_with_logits(logits, target)


def _descend(optimiser: torch.optim.Optimizer, loss: Tensor) -> None:
    optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    optimiser.step()
