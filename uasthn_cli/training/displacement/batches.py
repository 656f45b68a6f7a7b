"""Batches for displacement networks from any source of pairs, the same by number in every run."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from uasthn_cli.config import RESIZED_WIDTH_PX, CropTtaConfig
from uasthn_cli.datasets.samples import MatchDataset, MatchSample
from uasthn_cli.errors import TrainingDataError
from uasthn_cli.matching.displacement.homography import displacement_at_resized, resize_to_network
from uasthn_cli.training.batches import load_batches
from uasthn_cli.training.displacement.config import DisplacementConfig
from uasthn_cli.uncertainty.views import crop_views_px

_CHOICE, _BOXES = 0, 1
"""Random numbers of a batch for its samples and for the second stage's boxes."""

_VALIDATION_SAMPLES: Final = 48


@dataclass(frozen=True, slots=True)
class MatchBatch:
    """B pairs at W_R, and what the losses need to know of them.

    ``satellite`` and ``thermal`` ``(B, 3, 256, 256)`` in 0..1, the latter with equal channels;
    ``displacement`` ``(B, 4, 2)`` in pixels of W_R; ``crop_corners`` ``(N_C - 1, B, 4, 2)`` in the
    resized thermal image; ``fine_satellite`` ``(B, 3, F, F)`` uint8 for a second stage, else of
    width 0; ``box_noise`` ``(B, 4)`` in -1..1 for its box's edges.
    """

    satellite: Tensor
    thermal: Tensor
    displacement: Tensor
    crop_corners: Tensor
    fine_satellite: Tensor
    box_noise: Tensor

    def to(self, device: str) -> "MatchBatch":
        """Return the batch on a device."""
        return MatchBatch(*(getattr(self, field.name).to(device) for field in fields(self)))


class _Pair(NamedTuple):
    satellite: Tensor
    thermal: Tensor
    displacement: Tensor
    fine_satellite: Tensor


class MatchBatches(Dataset[MatchBatch]):
    """Training batches by number: seed and number alone decide what a batch holds.

    Each draws different samples, at random from all; so a run may be made longer and a source may
    be endless.
    """

    def __init__(self, dataset: MatchDataset, config: DisplacementConfig) -> None:
        """Draw from a data set that is not empty."""
        self._dataset, self._config = dataset, config

    def __len__(self) -> int:
        """Return the number of batches in a run."""
        return self._config.steps

    def __getitem__(self, number: int) -> MatchBatch:
        """Read or render a batch.

        Raises:
            DatasetError: a sample cannot be read.
        """
        config, count = self._config, len(self._dataset)
        rng = np.random.default_rng([config.seed, number, _CHOICE])
        indices = rng.choice(count, config.batch, replace=config.batch > count)
        pairs = [as_pair(self._dataset[int(index)], config) for index in indices]
        names = [f"{number}-{place}" for place in range(config.batch)]
        noise = np.random.default_rng([config.seed, number, _BOXES]).uniform(
            -1.0, 1.0, (config.batch, 4)
        )
        return _joined(pairs, _crops(names, config.views_at(number), config), noise)


def load_match_batches(
    dataset: MatchDataset, config: DisplacementConfig, start: int
) -> Iterator[MatchBatch]:
    """Return the batches of a run from number ``start`` on, made in worker processes."""
    # files that are open here must not be shared with forked workers: a copy opens its own
    return load_batches(MatchBatches(copy.copy(dataset), config), config.workers, start)


def validation_batches(dataset: MatchDataset, config: DisplacementConfig) -> Iterator[MatchBatch]:
    """Yield at most 48 evenly spread samples, whole thermal images only, in batches."""
    count = min(len(dataset), _VALIDATION_SAMPLES)
    spread = np.linspace(0, len(dataset) - 1, count).round().astype(np.int64)
    if len(dataset) > 2 * _VALIDATION_SAMPLES and not _is_short(dataset):
        spread = np.arange(count)
    for first in range(0, count, config.batch):
        chosen = spread[first : first + config.batch]
        pairs = [as_pair(dataset[int(index)], config) for index in chosen]
        names = [""] * len(pairs)
        yield _joined(pairs, _crops(names, 1, config), np.zeros((len(pairs), 4)))
