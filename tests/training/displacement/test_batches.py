"""Batches: where the thermal image truly lies, and the same batch by number in every run."""

from dataclasses import fields, replace
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from tiny_displacement import (
    SATELLITE_PX,
    THERMAL_PX,
    PatternPairs,
    pattern_sample,
    tiny_displacement_config,
)
from tiny_tgm import tiny_generator

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.errors import TrainingDataError
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px
from uasthn_cli.matching.displacement.homography import corners_at_width
from uasthn_cli.training.displacement.batches import (
    MatchBatch,
    MatchBatches,
    as_pair,
    fingerprint,
    load_match_batches,
    validation_batches,
    width_ratio,
)
from uasthn_cli.types import FloatArray

CONFIG = tiny_displacement_config(views=3, plain_steps=2, network="sthn")


def equal(a: MatchBatch, b: MatchBatch) -> bool:
    names = [field.name for field in fields(MatchBatch)]
    return all(torch.equal(getattr(a, name), getattr(b, name)) for name in names)


def turned_trapezium(yaw_deg: float) -> FloatArray:
    """Return corners of a footprint that is turned, higher than wide, and no rectangle."""
    yaw = np.deg2rad(yaw_deg)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    shape = np.array([[-40.0, -60.0], [45.0, -55.0], [-50.0, 58.0], [48.0, 66.0]])
    return np.asarray(shape @ turn.T + (160.0, 140.0))


@pytest.mark.parametrize("yaw_deg", [0.0, 25.0, 90.0, 200.0])
def test_convention_the_thermal_image_lies_at_the_displaced_corners(yaw_deg: float) -> None:
    pair = as_pair(pattern_sample(3, turned_trapezium(yaw_deg)), CONFIG)
    whole = image_corners_px(256, 256)
    H = homography_from_corners(whole, whole + pair.displacement.double().numpy())
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(pair.satellite[0].numpy(), H, (256, 256), flags=flags)
    inner = np.s_[8:-8, 8:-8]
    correlation = np.corrcoef(seen[inner].ravel(), pair.thermal[0].numpy()[inner].ravel())[0, 1]
    assert correlation > 0.99


def test_convention_displacements_are_the_inverse_of_what_estimators_answer() -> None:
    corners_px = turned_trapezium(25.0)
    pair = as_pair(pattern_sample(3, corners_px), CONFIG)
    answered = corners_at_width(pair.displacement.double(), SATELLITE_PX).numpy()
    assert np.allclose(answered, corners_px, atol=1e-3)


@pytest.mark.parametrize(("ratio", "side_px"), [(2.5, 250), (3.31, 331)])
def test_satellite_images_are_cut_or_padded_to_the_ratio(ratio: float, side_px: int) -> None:
    corners_px = turned_trapezium(0.0)
    pair = as_pair(pattern_sample(3, corners_px), replace(CONFIG, width_ratio=ratio))
    answered = corners_at_width(pair.displacement.double(), side_px).numpy()
    first_px = (SATELLITE_PX - side_px) // 2
    assert np.allclose(answered, corners_px - first_px, atol=1e-3)
    assert bool((pair.satellite[:, :3] == 0).all()) == (ratio > 3)
    whole = image_corners_px(256, 256)
    H = homography_from_corners(whole, whole + pair.displacement.double().numpy())
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(pair.satellite[0].numpy(), H, (256, 256), flags=flags)
    assert np.corrcoef(seen.ravel(), pair.thermal[0].numpy().ravel())[0, 1] > 0.98


def test_shapes_and_ranges() -> None:
    batch = MatchBatches(PatternPairs(5), CONFIG)[2]
    assert batch.satellite.shape == batch.thermal.shape == (2, 3, 256, 256)
    assert batch.satellite.min() >= 0 and batch.satellite.max() <= 1 + 1e-6
    assert torch.equal(batch.thermal[:, 0], batch.thermal[:, 2])
    assert batch.displacement.shape == (2, 4, 2)
    assert batch.crop_corners.shape == (2, 2, 4, 2)
    assert batch.fine_satellite.shape == (2, 3, SATELLITE_PX, SATELLITE_PX)
    assert batch.fine_satellite.dtype == torch.uint8
    assert batch.box_noise.shape == (2, 4) and batch.box_noise.abs().max() <= 1
    sides_px = batch.crop_corners[..., 3, :] - batch.crop_corners[..., 0, :]
    assert torch.allclose(sides_px, torch.full_like(sides_px, 255.0 - 16.0))
    assert batch.crop_corners.min() >= 0 and batch.crop_corners.max() <= 255 + 1e-4
    assert not torch.equal(batch.crop_corners[0, 0], batch.crop_corners[0, 1])


def test_before_the_crops_there_are_none_and_without_second_stage_no_fine_image() -> None:
    batch = MatchBatches(PatternPairs(5), replace(CONFIG, network="ihn"))[1]
    assert batch.crop_corners.shape == (0, 2, 4, 2)
    assert batch.fine_satellite.shape == (2, 3, 0, 0)


def test_a_batch_depends_on_seed_and_number_alone() -> None:
    batches = MatchBatches(PatternPairs(5), CONFIG)
    assert equal(batches[3], MatchBatches(PatternPairs(5), replace(CONFIG, steps=9))[3])
    assert not equal(batches[3], batches[2])
    assert not equal(batches[3], MatchBatches(PatternPairs(5), replace(CONFIG, seed=1))[3])
    later = list(load_match_batches(PatternPairs(5), CONFIG, 2))
    assert len(later) == 2
    assert equal(later[1], batches[3])


@pytest.mark.slow
def test_workers_change_nothing() -> None:
    apart = list(load_match_batches(PatternPairs(5), replace(CONFIG, workers=2), 1))
    here = list(load_match_batches(PatternPairs(5), CONFIG, 1))
    assert len(apart) == 3
    assert all(equal(a, b) for a, b in zip(apart, here, strict=True))


def drawing(share: float, **changes: Any) -> MatchBatches:
    config = replace(CONFIG, network="dhn", batch=8, tgm_share=share, **changes)
    return MatchBatches(PatternPairs(5), config, tiny_generator())


def test_a_generator_draws_its_share_and_nothing_else_changes() -> None:
    plain = MatchBatches(PatternPairs(5), replace(CONFIG, network="dhn", batch=8))
    shares = []
    for number in range(4):
        before, after = plain[number], drawing(0.5)[number]
        assert equal(replace(after, thermal=before.thermal), before)
        drawn = (after.thermal != before.thermal).flatten(1).any(dim=1)
        assert torch.equal(drawing(1.0)[number].thermal[drawn], after.thermal[drawn])
        shares.append(drawn.float().mean().item())
    assert 0.2 < np.mean(shares) < 0.8
    assert (drawing(1.0)[0].thermal != plain[0].thermal).flatten(1).any(dim=1).all()


def test_what_is_drawn_depends_on_seed_and_number_alone() -> None:
    assert equal(drawing(0.5)[3], drawing(0.5, steps=9)[3])
    assert not equal(drawing(0.5)[3], drawing(0.5, seed=1)[3])


@pytest.mark.slow
def test_workers_draw_the_same() -> None:
    config = replace(CONFIG, network="dhn", tgm_share=0.5)
    generator = tiny_generator()
    here = list(load_match_batches(PatternPairs(5), config, 0, generator))
    apart = load_match_batches(PatternPairs(5), replace(config, workers=2), 0, generator)
    assert all(equal(a, b) for a, b in zip(apart, here, strict=True))


def test_samples_of_a_batch_differ_where_there_are_enough() -> None:
    config = replace(CONFIG, batch=5)
    for number in range(4):
        displacements = MatchBatches(PatternPairs(5), config)[number].displacement
        assert len(torch.unique(displacements, dim=0)) == 5
    assert len(MatchBatches(PatternPairs(2), config)[0].displacement) == 5


def test_an_endless_source_is_no_burden() -> None:
    assert MatchBatches(PatternPairs(2**31 - 1), CONFIG)[0].displacement.shape == (2, 4, 2)


def test_validation_sees_whole_images_spread_over_the_source() -> None:
    batches = list(validation_batches(PatternPairs(5), CONFIG))
    assert [len(batch.thermal) for batch in batches] == [2, 2, 1]
    assert all(batch.crop_corners.shape[0] == 0 for batch in batches)
    assert sum(len(b.thermal) for b in validation_batches(PatternPairs(2000), CONFIG)) == 48


def test_fingerprints_tell_data_sets_apart() -> None:
    assert fingerprint(PatternPairs(4)) == fingerprint(PatternPairs(4))
    assert fingerprint(PatternPairs(4)) != fingerprint(PatternPairs(4, first_seed=1))
    assert width_ratio(PatternPairs(1)) == SATELLITE_PX / THERMAL_PX


def test_nothing_to_learn_from_is_refused() -> None:
    with pytest.raises(TrainingDataError, match="no pair"):
        fingerprint(PatternPairs(0))


def test_corners_that_are_no_numbers_are_refused() -> None:
    sample = PatternPairs(1)[0]
    bad = MatchSample("odd", sample.satellite, sample.thermal, sample.corners_px * np.nan, 1.0)
    with pytest.raises(TrainingDataError, match="odd: its corners are not finite"):
        as_pair(bad, CONFIG)
