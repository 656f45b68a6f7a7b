"""Train dhn, ihn or sthn: batches in, losses out, a checkpoint every so often."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple, Protocol, cast

import numpy as np
import torch
from torch import Tensor, nn

from uasthn_cli.datasets.samples import MatchDataset
from uasthn_cli.matching.displacement.homography import sample_boxes
from uasthn_cli.matching.displacement.network import Refinement
from uasthn_cli.matching.displacement.sthn import (
    SecondLook,
    TwoStageHomographyNetwork,
    bounding_boxes,
    displacement_of_boxes,
)
from uasthn_cli.training.displacement.batches import (
    MatchBatch,
    load_match_batches,
    validation_batches,
)
from uasthn_cli.training.displacement.boxes import displacement_in_boxes, perturbed_boxes
from uasthn_cli.training.displacement.config import PAPER_SATELLITE_PX, DisplacementConfig
from uasthn_cli.training.displacement.losses import (
    croptta_loss,
    direct_modeling_loss,
    sequence_loss,
)
from uasthn_cli.training.loop import Lesson, Progress, Validation, take_steps
from uasthn_cli.training.tgm.thermal_generator import ThermalGenerator
from uasthn_cli.training.trainee import Trainee

_SEED_STRIDE: Final = 1_000_003
"""Dropout of step n of a seed is that of no step of another seed, in any run of a real length."""


class Locator(Protocol):
    """One stage: dhn, or a whole or half of what is iterated."""

    def __call__(self, satellite: Tensor, thermal: Tensor, iterations: int) -> Refinement:
        """Locate thermal images ``(N * B, 3, 256, 256)`` in B satellite images.

        View ``n`` of sample ``b`` is number ``n * B + b``; the satellite images' features are
        computed once for all of their views.
        """


class Stages(NamedTuple):
    """The first stage, and the second one of ``sthn``."""

    coarse: Locator
    fine: Locator | None


def stages_of(network: nn.Module) -> Stages:
    """Return the stages of a network."""
    if isinstance(network, TwoStageHomographyNetwork):
        return Stages(network.netG, network.netG_fine)
    return Stages(cast("Locator", network), None)


def train_displacement_steps(
    trainee: Trainee[nn.Module],
    dataset: MatchDataset,
    config: DisplacementConfig,
    checkpoint_path: Path,
    on_step: Callable[[int], None] = lambda _: None,
    generator: ThermalGenerator | None = None,
) -> Iterator[Progress]:
    """Train to the last step; yields after every checkpoint, calls ``on_step`` after every step.

    On a CPU with the same number of threads, a resumed run ends with the same bits as an unbroken
    one. Errors are the mean of four corners' distances (MACE) in pixels of W_R.

    Raises:
        TrainingDivergedError: the loss is no longer finite; the last checkpoint stays.
        OutputError: a checkpoint cannot be written.
        DatasetError: a sample cannot be read.
    """
    trainee.model.train()

    def learn(batch: MatchBatch) -> Lesson:
        torch.manual_seed(config.seed * _SEED_STRIDE + trainee.step)  # of dropout
        return lesson(stages_of(trainee.model), batch.to(config.device), config)

    return take_steps(
        trainee,
        lambda start: load_match_batches(dataset, config, start, generator),
        learn,
        config.learning_rate_at,
        config,
        checkpoint_path,
        on_step,
    )


def lesson(stages: Stages, batch: MatchBatch, config: DisplacementConfig) -> Lesson:
    """Return a batch's loss, the sum over stages, and the last stage's errors."""
    if config.first_stage == "frozen":
        with torch.no_grad():
            found, loss = _first_look(stages.coarse, batch, config)
    else:
        found, loss = _first_look(stages.coarse, batch, config)
    if stages.fine is not None:
        look = _second_look(stages.fine, batch, found.detach(), config)
        width_px = batch.fine_satellite.shape[-1]
        truth = displacement_in_boxes(look.boxes_px, batch.displacement, width_px)
        fine_loss = sequence_loss(look.fine.displacements, truth, config.decay)
        loss = fine_loss if config.first_stage == "frozen" else loss + fine_loss
        found = look.displacement
    return Lesson(loss, corner_errors_px(found, batch.displacement))


@torch.no_grad()
def validate_displacement(
    network: nn.Module, dataset: MatchDataset, config: DisplacementConfig
) -> Validation:
    """Return the MACE in pixels of W_R on pairs that training never draws, as in evaluation."""
    network.eval()
    stages, errors = stages_of(network), []
    for cpu_batch in validation_batches(dataset, config):
        batch = cpu_batch.to(config.device)
        found = stages.coarse(batch.satellite, batch.thermal, config.iterations).last
        if stages.fine is not None:
            width_px = batch.fine_satellite.shape[-1]
            padding_px = 0.5 * config.box_expansion_px * width_px / PAPER_SATELLITE_PX
            boxes_px = bounding_boxes(found, width_px, padding_px)
            found = _look(stages.fine, batch, boxes_px, config).displacement
        errors.append(corner_errors_px(found, batch.displacement))
    network.train()
    joined = np.concatenate(errors)
    return Validation(float(np.median(joined)), float(np.mean(joined < 4)))


def corner_errors_px(found: Tensor, truth: Tensor) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
    """Return the mean distance ``(B,)`` of four corners, from displacements ``(B, 4, 2)``."""
    distances = (found.detach() - truth).norm(dim=-1).mean(dim=-1)
    return np.asarray(distances.float().cpu().numpy())


def _first_look(
    coarse: Locator, batch: MatchBatch, config: DisplacementConfig
) -> tuple[Tensor, Tensor]:
    """Return where the first stage sees the whole images ``(B, 4, 2)``, and its loss."""
    samples = len(batch.thermal)
    crops = [sample_boxes(batch.thermal, corners) for corners in batch.crop_corners]
    with _autocast(config):
        seen = coarse(batch.satellite, torch.cat([batch.thermal, *crops]), config.iterations)
    found = seen.last[:samples].float()
    if config.direct_modeling:
        return found, direct_modeling_loss(seen, batch.displacement, config.decay)
    displacements = seen.displacements.float()
    return found, croptta_loss(displacements, batch.displacement, batch.crop_corners, config.decay)


def _second_look(
    fine: Locator, batch: MatchBatch, found: Tensor, config: DisplacementConfig
) -> SecondLook:
    """Look at boxes around what the first stage found, as the paper perturbs them."""
    width_px = batch.fine_satellite.shape[-1]
    reach_px = config.box_augmentation_px * width_px / PAPER_SATELLITE_PX
    boxes_px = perturbed_boxes(found, batch.box_noise, width_px, reach_px)
    return _look(fine, batch, boxes_px, config)


def _look(
    fine: Locator, batch: MatchBatch, boxes_px: Tensor, config: DisplacementConfig
) -> SecondLook:
    cut = sample_boxes(batch.fine_satellite.float() / 255.0, boxes_px)
    with _autocast(config):
        seen = fine(cut, batch.thermal, config.fine_iterations)
    width_px = batch.fine_satellite.shape[-1]
    return SecondLook(boxes_px, seen, displacement_of_boxes(boxes_px, seen.last.float(), width_px))


def _autocast(config: DisplacementConfig) -> torch.autocast:
    device_type = torch.device(config.device).type
    return torch.autocast(device_type, torch.bfloat16, enabled=config.bfloat16)
