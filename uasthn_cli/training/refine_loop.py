"""Train the refiner on top of finished encoders."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from uasthn_cli.errors import TrainingDivergedError
from uasthn_cli.matching.correlate import cell_mask
from uasthn_cli.matching.networks import STRIDE_PX, XcorrModel
from uasthn_cli.matching.refine import TRAINING_ITERATIONS, apply_homography, homography
from uasthn_cli.training.batches import load_batches
from uasthn_cli.training.losses import window_statistics
from uasthn_cli.training.samples import CANVAS_PX, Batch, SampleConfig, SampleDataset
from uasthn_cli.training.scenes import SceneSet

_SEQUENCE_DECAY = 0.85
_START_ERROR_CELLS = 1.0
_REPORT_EVERY = 50
_WARM_UP_SHARE = 0.1
_SHORTEST_WITH_WARM_UP = 10
"""A warm-up of a single step divides by zero in PyTorch's schedule."""


@dataclass(frozen=True, slots=True)
class RefineConfig:
    """Length, pace and seed of the refiner's training."""

    steps: int = 600
    learning_rate: float = 2e-3
    seed: int = 0
    device: str = "cpu"
    bfloat16: bool = True
    workers: int = 1
    samples: SampleConfig = SampleConfig(windows=4, canvases=4)  # noqa: RUF009 (frozen)


@dataclass(frozen=True, slots=True)
class RefineProgress:
    """Mean corner error in pixels before and after refinement since the last report."""

    step: int
    seconds: float
    before_px: float
    after_px: float


def train_refiner(
    model: XcorrModel, scenes: SceneSet, config: RefineConfig
) -> Iterator[RefineProgress]:
    """Train ``model.refiner`` in place with the paper's sequence loss; encoders stay as they are.

    The start is what the search leaves: the true shift within about a cell, the prior's rotation,
    scale and tilt.

    Raises:
        TrainingDivergedError: the loss is no longer finite.
    """
    model.eval()
    model.refiner.train()
    optimiser = torch.optim.AdamW(model.refiner.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser,
        config.learning_rate,
        total_steps=config.steps,
        pct_start=_WARM_UP_SHARE if config.steps > _SHORTEST_WITH_WARM_UP else 0.0,
    )
    generator = torch.Generator().manual_seed(config.seed)
    started, errors = time.monotonic(), []
    for step, batch in enumerate(_batches(scenes, config), start=1):
        window, template, mask, truth, start = refine_inputs(
            model, batch, generator, device=config.device, bfloat16=config.bfloat16
        )
        sequence = model.refiner(window, template, mask, start, TRAINING_ITERATIONS)
        loss = sequence_loss(sequence, truth)
        if not math.isfinite(loss.item()):
            raise TrainingDivergedError(f"the refiner's loss is no longer finite at step {step}")
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(model.refiner.parameters(), 1.0)
        optimiser.step()
        schedule.step()
        errors.append([corner_error_px(start, truth), corner_error_px(sequence[-1], truth)])
        if step % _REPORT_EVERY == 0 or step == config.steps:
            before, after = np.mean(errors, axis=0)
            errors = []
            yield RefineProgress(step, time.monotonic() - started, float(before), float(after))
    model.refiner.eval()


def sequence_loss(sequence: list[Tensor], truth: Tensor) -> Tensor:
    """Return the L1 distance of corners to truth, later iterations weighing more (paper, eq. 9)."""
    last = len(sequence) - 1
    terms = [
        _SEQUENCE_DECAY ** (last - k) * (corners - truth).abs().mean()
        for k, corners in enumerate(sequence)
    ]
    return torch.stack(terms).sum()


def corner_error_px(corners: Tensor, truth: Tensor) -> float:
    """Return the median over samples of the mean corner error, in pixels."""
    error = (corners.detach() - truth).norm(dim=-1).mean(dim=-1) * STRIDE_PX
    return float(error.median())


def refine_inputs(
    model: XcorrModel, batch: Batch, generator: torch.Generator, *, device: str, bfloat16: bool
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Return window and template features, mask, true and starting corners in cells."""
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
    canvases = thermal.shape[1]
    flat, flat_valid = thermal.flatten(0, 1), valid.flatten(0, 1)
    with (
        torch.no_grad(),
        torch.autocast(torch.device(device).type, torch.bfloat16, enabled=bfloat16),
    ):
        mean, deviation = window_statistics(satellite, satellite_valid)
        window = model.encode_satellite(satellite, satellite_valid, mean, deviation)
        template = model.encode_thermal(flat, flat_valid)
    window = window.float() * cell_mask(satellite_valid, STRIDE_PX)
    truth = _cell_corners(corners.flatten(0, 1))
    centre = truth.mean(dim=1, keepdim=True)
    half = (CANVAS_PX / STRIDE_PX - 1) / 2
    square = torch.tensor([[-half, -half], [half, -half], [-half, half], [half, half]])
    noise = torch.randn(len(truth), 1, 2, generator=generator) * _START_ERROR_CELLS
    start = centre + square.to(device) + noise.to(device)
    mask = cell_mask(flat_valid, STRIDE_PX)
    return window.repeat_interleave(canvases, dim=0), template.float(), mask, truth, start


def _cell_corners(corners_px: Tensor) -> Tensor:
    """Return where the template's corner cells lie, from where the canvas's corner pixels do."""
    edge, inner = CANVAS_PX - 1.0, CANVAS_PX - 1.5
    pixels = torch.tensor([[0.0, 0.0], [edge, 0.0], [0.0, edge], [edge, edge]])
    cells = torch.tensor([[0.5, 0.5], [inner, 0.5], [0.5, inner], [inner, inner]])
    count = len(corners_px)
    H = homography(pixels.to(corners_px).expand(count, -1, -1), corners_px)
    places = apply_homography(H, cells.to(corners_px).expand(count, -1, -1))
    return (places - 0.5) / STRIDE_PX


def _batches(scenes: SceneSet, config: RefineConfig) -> Iterator[Batch]:
    dataset = SampleDataset(
        scenes, config.samples, seed=config.seed + 2_000_003, batches=config.steps
    )
    return load_batches(dataset, config.workers)
