"""Batches for displacement networks from any source of pairs, the same by number in every run."""

import copy
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uasthn_cli.config import RESIZED_WIDTH_PX, Sampling
from uasthn_cli.datasets.samples import MatchDataset, MatchSample
from uasthn_cli.errors import TrainingDataError
from uasthn_cli.geometry.crops import crop_corners_px
from uasthn_cli.matching.displacement.homography import displacement_at_resized, resize_to_network
from uasthn_cli.training.batches import load_batches
from uasthn_cli.training.displacement.config import DisplacementConfig
from uasthn_cli.training.tgm.generated_thermal import GeneratedThermal
from uasthn_cli.training.tgm.thermal_generator import ThermalGenerator
from uasthn_cli.types import FloatArray

_CHOICE, _CROPS, _BOXES, _DRAWN = range(4)
"""Streams of random numbers: a batch's samples do not depend on how many crops they have."""

_VALIDATION_SAMPLES: Final = 48
_PROBES: Final = 3


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


class MatchBatches:
    """Training batches by number: seed and number alone decide what a batch holds.

    Each draws different samples, at random from all; so a run may be made longer and a source may
    be endless.
    """

    def __init__(
        self,
        dataset: MatchDataset,
        config: DisplacementConfig,
        generator: ThermalGenerator | None = None,
    ) -> None:
        """Draw from a data set that is not empty.

        A ``generator`` draws the thermal images of ``config.tgm_share`` of the samples.
        """
        self._dataset, self._config = dataset, config
        self._generated = None if generator is None else GeneratedThermal(dataset, generator)

    def __len__(self) -> int:
        """Return the number of batches in a run."""
        return self._config.steps

    def __getitem__(self, number: int) -> MatchBatch:
        """Read or render a batch.

        Raises:
            DatasetError: a sample cannot be read.
        """
        config, count = self._config, len(self._dataset)
        choice, places, boxes = (
            np.random.default_rng([config.seed, number, stream])
            for stream in (_CHOICE, _CROPS, _BOXES)
        )
        indices = choice.choice(count, config.batch, replace=config.batch > count)
        sources = self._sources(number)
        pairs = [as_pair(sources[k][int(index)], config) for k, index in enumerate(indices)]
        views = config.views_at(number)
        crops = np.stack([_crops(places, views, config) for _ in pairs], axis=1)
        return _joined(pairs, crops, boxes.uniform(-1.0, 1.0, (config.batch, 4)))

    def _sources(self, number: int) -> list[MatchDataset]:
        """Return where each pair of a batch comes from: as it is, or with a drawn thermal image."""
        config = self._config
        if self._generated is None:
            return [self._dataset] * config.batch
        lots = np.random.default_rng([config.seed, number, _DRAWN]).random(config.batch)
        return [self._generated if lot < config.tgm_share else self._dataset for lot in lots]


def load_match_batches(
    dataset: MatchDataset,
    config: DisplacementConfig,
    start: int,
    generator: ThermalGenerator | None = None,
) -> Iterator[MatchBatch]:
    """Return the batches of a run from number ``start`` on, made in worker processes."""
    # files that are open here must not be shared with forked workers: a copy opens its own
    batches = MatchBatches(copy.copy(dataset), config, generator)
    return load_batches(batches, config.workers, start)


def validation_batches(dataset: MatchDataset, config: DisplacementConfig) -> Iterator[MatchBatch]:
    """Yield at most 48 evenly spread samples, whole thermal images only, in batches."""
    count = min(len(dataset), _VALIDATION_SAMPLES)
    spread = np.linspace(0, len(dataset) - 1, count).round().astype(np.int64)
    for first in range(0, count, config.batch):
        chosen = spread[first : first + config.batch]
        pairs = [as_pair(dataset[int(index)], config) for index in chosen]
        no_crops = np.zeros((0, len(pairs), 4, 2))
        yield _joined(pairs, no_crops, np.zeros((len(pairs), 4)))


def as_pair(sample: MatchSample, config: DisplacementConfig) -> _Pair:
    """Resize one sample as the networks see it, its truth at W_R as they state displacements.

    Raises:
        TrainingDataError: the sample's corners are not finite.
    """
    satellite, first_px = _at_ratio(sample, config.width_ratio)
    corners = torch.from_numpy(np.asarray(sample.corners_px, np.float64) - first_px)
    if not torch.isfinite(corners).all():
        raise TrainingDataError(f"{sample.name}: its corners are not finite")
    thermal = np.repeat(sample.thermal[..., None], 3, axis=2)
    return _Pair(
        resize_to_network(_in_unit_range(satellite))[0],
        resize_to_network(_in_unit_range(thermal))[0],
        displacement_at_resized(corners, satellite.shape[0]).float(),
        _fine(satellite, config),
    )


def width_ratio(dataset: MatchDataset) -> float:
    """Return how much wider satellite images are than thermal ones, in the first sample.

    Raises:
        TrainingDataError: the data set is empty.
    """
    _require_samples(dataset)
    sample = dataset[0]
    return float(sample.satellite.shape[0] / sample.thermal.shape[0])


def fingerprint(dataset: MatchDataset) -> str:
    """Return a digest of the first few samples, by which another data set is noticed.

    Raises:
        TrainingDataError: the data set is empty.
    """
    _require_samples(dataset)
    digest = hashlib.sha256()
    for index in range(min(len(dataset), _PROBES)):
        sample = dataset[index]
        for array in (sample.satellite, sample.thermal, np.asarray(sample.corners_px)):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _require_samples(dataset: MatchDataset) -> None:
    if len(dataset) == 0:
        raise TrainingDataError("the data set holds no pair to learn from")


def _at_ratio(sample: MatchSample, ratio: float) -> tuple[NDArray[np.uint8], FloatArray]:
    """Return the middle of the satellite image at this ratio of widths, and its first pixel.

    Black where it reaches beyond: as the estimators see a map's edge.
    """
    width_px, side_px = sample.satellite.shape[0], round(ratio * sample.thermal.shape[0])
    first_px = (width_px - side_px) // 2
    before, after = max(0, -first_px), max(0, first_px + side_px - width_px)
    padded = np.pad(sample.satellite, ((before, after), (before, after), (0, 0)))
    start = max(0, first_px)
    cut = padded[start : start + side_px, start : start + side_px]
    return np.ascontiguousarray(cut), np.full(2, float(first_px))


def _in_unit_range(image: NDArray[np.uint8]) -> Tensor:
    """Return an image ``(h, w, 3)`` as ``(1, 3, h, w)`` in 0..1."""
    return torch.from_numpy(image).movedim(2, 0)[None].float() / 255.0


def _fine(satellite: NDArray[np.uint8], config: DisplacementConfig) -> Tensor:
    """Return the satellite image ``(3, F, F)`` that a second stage cuts its boxes from."""
    if config.network != "sthn":
        return torch.zeros(3, 0, 0, dtype=torch.uint8)
    side_px = config.fine_satellite_px
    if satellite.shape[0] != side_px:
        way = cv2.INTER_AREA if satellite.shape[0] > side_px else cv2.INTER_LINEAR
        satellite = np.asarray(cv2.resize(satellite, (side_px, side_px), interpolation=way))
    return torch.from_numpy(np.ascontiguousarray(satellite.transpose(2, 0, 1)))


def _crops(rng: np.random.Generator, views: int, config: DisplacementConfig) -> FloatArray:
    """Return the corners ``(views - 1, 4, 2)`` of random crops."""
    size_px = (RESIZED_WIDTH_PX, RESIZED_WIDTH_PX)
    offset_px = config.crop_offset_fraction * RESIZED_WIDTH_PX
    return crop_corners_px(size_px, views, (offset_px, offset_px), Sampling.RANDOM, rng)[1:]


def _joined(pairs: Sequence[_Pair], crops: FloatArray, box_noise: FloatArray) -> MatchBatch:
    satellite, thermal, displacement, fine = (
        torch.stack(column) for column in zip(*pairs, strict=True)
    )
    corners, noise = torch.from_numpy(crops).float(), torch.from_numpy(box_noise).float()
    return MatchBatch(satellite, thermal, displacement, corners, fine, noise)
