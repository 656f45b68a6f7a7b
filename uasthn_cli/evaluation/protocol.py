"""Run estimators over pairs as the paper does (sec. IV), through the one seam all share."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.datasets.samples import MatchDataset, MatchSample
from uasthn_cli.evaluation.canvas import Placed, place_pair, prior_corners_px
from uasthn_cli.evaluation.predictions import Prediction
from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    homography_from_corners,
    transform_points,
)
from uasthn_cli.matching.waiting import wait_for_gpu
from uasthn_cli.seam import Estimator
from uasthn_cli.types import BoolArray, FloatArray, MapFeatures
from uasthn_cli.uncertainty.views import crop_views_px

WARM_UP_RUNS: Final = 2
"""Estimates before the clock counts: the first ones load kernels and fill caches."""

SINGLE_TIMED: Final = 50
"""On so many samples one view alone is timed as well: it costs a second estimate."""


@dataclass(frozen=True, slots=True)
class ProtocolConfig:
    """How views are cropped, and the width at which images are matched (None: their own)."""

    crops: CropTtaConfig = field(default_factory=CropTtaConfig)
    width_px: int | None = None


def predict(
    dataset: MatchDataset,
    estimators: Sequence[Estimator],
    config: ProtocolConfig,
    *,
    start: int = 0,
) -> Iterator[Prediction]:
    """Yield what estimators say of each sample from ``start`` on.

    The first estimator sees all views; further ones (ensemble members) the full frame.
    """
    for index in range(start, len(dataset)):
        sample = dataset[index]
        if index == start:
            for _ in range(WARM_UP_RUNS):
                predict_sample(sample, estimators, config, time_single=True)
        yield predict_sample(sample, estimators, config, time_single=index < SINGLE_TIMED)


def predict_sample(
    sample: MatchSample,
    estimators: Sequence[Estimator],
    config: ProtocolConfig,
    *,
    time_single: bool,
) -> Prediction:
    """Return what estimators say of one sample, and how long that took them."""
    placed = place_pair(sample, config.width_px)
    thermal_px = sample.thermal.shape[0]
    views_px = crop_views_px(thermal_px, thermal_px, config.crops, sample.name)
    answers_px = np.full((len(estimators), len(views_px), 4, 2), np.nan)
    base, *others = estimators
    features, encode_s = _encoded(base, placed)
    answers_px[0], stated, views_s = _answers(base, features, placed, views_px)
    single_s = views_s
    if len(views_px) > 1:
        single_s = np.nan
        if time_single:
            single_s = _answers(base, features, placed, views_px[:1])[2]
    members_s = 0.0
    for member, other in enumerate(others, start=1):
        own, own_s = _encoded(other, placed)
        answers_px[member, :1], _, estimate_s = _answers(other, own, placed, views_px[:1])
        members_s += own_s + estimate_s
    return Prediction(
        name=sample.name,
        gsd_m=sample.satellite_gsd_m,
        satellite_px=sample.satellite.shape[0],
        true_px=sample.corners_px,
        prior_px=prior_corners_px(sample),
        answers_px=answers_px,
        modelled_std_px=stated.std_px,
        confidence=stated.confidence,
        seconds=np.array([encode_s + single_s, encode_s + views_s, members_s]),
    )


@dataclass(frozen=True, slots=True)
class _Stated:
    """What an estimator says of its own answer: confidence, and deviations ``(4, 2)`` or NaN."""

    confidence: float
    std_px: FloatArray


def _encoded(estimator: Estimator, placed: Placed) -> tuple[MapFeatures, float]:
    """Return an estimator's features of the window, and the seconds they took."""
    window, stride_px = placed.window, estimator.stride_px
    started_s = time.perf_counter()
    values = estimator.encode_map(window)
    wait_for_gpu()
    seconds = time.perf_counter() - started_s
    valid = _whole_cells(window.valid, stride_px)
    return MapFeatures(values, valid, window.box, window.grid, stride_px), seconds


def _whole_cells(valid: BoolArray, stride_px: int) -> BoolArray:
    """Return which cells are valid in all of their pixels."""
    rows, columns = (side // stride_px for side in valid.shape)
    blocks = valid.reshape(rows, stride_px, columns, stride_px)
    return np.asarray(blocks.all(axis=(1, 3)))


def _answers(
    estimator: Estimator, features: MapFeatures, placed: Placed, views_px: FloatArray
) -> tuple[FloatArray, _Stated, float]:
    """Return the full frame's corners by each view in satellite pixels, what is stated, seconds.

    ``views_px`` ``(V, 4, 2)`` are thermal pixels; corners ``(V, 4, 2)`` are NaN without an answer.
    """
    ortho_views_px = transform_points(placed.thermal.H_frame_ortho, views_px)
    started_s = time.perf_counter()
    try:
        estimate = estimator.estimate(features, placed.thermal, ortho_views_px, placed.origin_px)
    except DegenerateHomographyError:
        wait_for_gpu()
        nothing = _Stated(0.0, np.full((4, 2), np.nan))
        return np.full(views_px.shape, np.nan), nothing, time.perf_counter() - started_s
    wait_for_gpu()
    seconds = time.perf_counter() - started_s
    found_px = placed.to_satellite(estimate.corners_px)
    recovered = [_recovered(views_px, found_px, view) for view in range(len(views_px))]
    std_px = estimate.modelled_std_px
    if std_px is None:
        std_px = np.full((4, 2), np.nan)
    scale = placed.to_satellite(np.array([[0.0, 0.0], [1.0, 0.0]]))
    std_px = std_px * float(np.linalg.norm(scale[1] - scale[0]))
    return np.stack(recovered), _Stated(estimate.confidence, std_px), seconds


def _recovered(views_px: FloatArray, found_px: FloatArray, view: int) -> FloatArray:
    """Return the full frame's corners ``(4, 2)`` as one view implies them, NaN if it does not.

    As :func:`uasthn_cli.uncertainty.consensus.recover_corners`, but one bad view spoils no other.
    """
    if not np.isfinite(found_px[view]).all():
        return np.full((4, 2), np.nan)
    try:
        H_thermal_satellite = homography_from_corners(views_px[view], found_px[view])
        return transform_points(H_thermal_satellite, views_px[0])
    except DegenerateHomographyError:
        return np.full((4, 2), np.nan)
