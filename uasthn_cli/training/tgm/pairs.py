"""Aligned pairs: what the satellite sees on the footprint of a thermal image, pixel by pixel."""

import hashlib
import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uasthn_cli.datasets.samples import MatchDataset, MatchSample
from uasthn_cli.errors import TrainingDataError
from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    area_px,
    homography_from_corners,
    image_corners_px,
    transform_points,
)
from uasthn_cli.geometry.pixels import resize_homography
from uasthn_cli.types import FloatArray

_PROBES: Final = 16
_ROUNDING: Final = 1e-6
_GREY_LEVELS: Final = 127.5


class PairBatch(NamedTuple):
    """Satellite ``(B, 3, s, s)`` and thermal ``(B, 1, s, s)`` images in -1..1."""

    satellite: Tensor
    thermal: Tensor


@dataclass(frozen=True, slots=True)
class PairsSummary:
    """A data set at a glance: its size, its resolution at the training size, a fingerprint.

    ``gsd_m`` is the median, in metres on the ground per pixel of an aligned pair.
    """

    pairs: int
    gsd_m: float
    fingerprint: str


def footprint_px(sample: MatchSample) -> float:
    """Return the side, in satellite pixels, of a square of the area that the thermal image covers.

    Raises:
        TrainingDataError: the sample's corners enclose no area.
    """
    height_px, width_px = sample.thermal.shape
    right, bottom = width_px - 0.5, height_px - 0.5
    outer = np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]])
    return math.sqrt(abs(area_px(transform_points(_thermal_to_satellite(sample), outer))))


def aligned_satellite(sample: MatchSample, size_px: int) -> NDArray[np.uint8]:
    """Return the satellite image ``(size_px, size_px, 3)`` on the thermal image's footprint.

    Black beyond the satellite image. Where that is finer, it is averaged, so nothing aliases.

    Raises:
        TrainingDataError: the sample's corners enclose no area.
    """
    oversampling = max(1, math.ceil(footprint_px(sample) / size_px - _ROUNDING))
    fine_px = oversampling * size_px
    H_fine_thermal = resize_homography((fine_px, fine_px), sample.thermal.shape[::-1])
    H_fine_satellite = _thermal_to_satellite(sample) @ H_fine_thermal
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    fine = cv2.warpPerspective(sample.satellite, H_fine_satellite, (fine_px, fine_px), flags=flags)
    if oversampling > 1:
        fine = cv2.resize(fine, (size_px, size_px), interpolation=cv2.INTER_AREA)
    return np.asarray(fine, dtype=np.uint8)


def resized_thermal(thermal: NDArray[np.uint8], size_px: int) -> NDArray[np.uint8]:
    """Return a thermal image at another size, averaged where that is smaller."""
    way = cv2.INTER_AREA if size_px < max(thermal.shape) else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(thermal, (size_px, size_px), interpolation=way), dtype=np.uint8)


def summarise(dataset: MatchDataset, size_px: int) -> PairsSummary:
    """Return a data set's summary; fingerprint and resolution come from sixteen of its samples.

    Raises:
        TrainingDataError: the data set is empty.
    """
    if len(dataset) == 0:
        raise TrainingDataError("the data set holds no pair to learn from")
    digest = hashlib.sha256(str(len(dataset)).encode())
    gsds_m = []
    for index in sorted({int(k) for k in np.linspace(0, len(dataset) - 1, _PROBES)}):
        sample = dataset[index]
        digest.update(sample.name.encode())
        digest.update(aligned_satellite(sample, size_px).tobytes())
        digest.update(np.ascontiguousarray(sample.thermal).tobytes())
        gsds_m.append(footprint_px(sample) * sample.satellite_gsd_m / size_px)
    return PairsSummary(len(dataset), float(np.median(gsds_m)), digest.hexdigest())


class PairBatches:
    """Batches by number: every pass over the data set in a new order, mirrored and jittered.

    Batch ``n`` of a seed is the same in every run.
    """

    def __init__(
        self, dataset: MatchDataset, *, batch: int, size_px: int, jitter_px: int, seed: int
    ) -> None:
        """Draw from a data set that is not empty."""
        self._dataset, self._batch, self._seed = dataset, batch, seed
        self._size_px, self._jitter_px = size_px, jitter_px

    def __getitem__(self, number: int) -> PairBatch:
        """Return a batch."""
        rng = np.random.default_rng((self._seed, 1, number))
        first = number * self._batch
        pairs = [self._pair(rng, self._index(first + k)) for k in range(self._batch)]
        satellite, thermal = zip(*pairs, strict=True)
        return PairBatch(as_tensor(np.stack(satellite)), as_tensor(np.stack(thermal)))

    def _index(self, drawn: int) -> int:
        """Return which sample is drawn after ``drawn`` others."""
        epoch, place = divmod(drawn, len(self._dataset))
        order = np.random.default_rng((self._seed, 0, epoch)).permutation(len(self._dataset))
        return int(order[place])

    def _pair(
        self, rng: np.random.Generator, index: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        sample = self._dataset[index]
        whole_px = self._size_px + self._jitter_px
        top, left = rng.integers(0, self._jitter_px + 1, 2)
        mirror = -1 if rng.random() < 0.5 else 1
        crop = np.s_[top : top + self._size_px, left : left + self._size_px]
        satellite = aligned_satellite(sample, whole_px)[crop][:, ::mirror]
        return satellite, resized_thermal(sample.thermal, whole_px)[crop][:, ::mirror, None]


def as_tensor(images: NDArray[np.uint8]) -> Tensor:
    """Return images ``(B, h, w, channels)`` as ``(B, channels, h, w)`` in -1..1."""
    values = torch.from_numpy(np.ascontiguousarray(np.moveaxis(images, -1, 1)))
    return values.float() / _GREY_LEVELS - 1.0


def grey_levels(values: Tensor) -> NDArray[np.uint8]:
    """Return values in -1..1 as grey levels 0..255, of the same shape."""
    levels = ((values.detach().float().cpu() + 1.0) * _GREY_LEVELS).round().clamp(0, 255)
    return np.asarray(levels.numpy(), dtype=np.uint8)


def _thermal_to_satellite(sample: MatchSample) -> FloatArray:
    height_px, width_px = sample.thermal.shape
    try:
        return homography_from_corners(image_corners_px(width_px, height_px), sample.corners_px)
    except DegenerateHomographyError as error:
        raise TrainingDataError(f"{sample.name}: its corners enclose no area ({error})") from error
