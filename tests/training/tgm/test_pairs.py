"""Aligned pairs show the same ground in the same pixel."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_tgm import ListedPairs, listed_pairs, pair

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.errors import TrainingDataError
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.pixels import resize_homography
from uasthn_cli.training.tgm.pairs import (
    PairBatches,
    aligned_satellite,
    as_tensor,
    footprint_px,
    grey_levels,
    resized_thermal,
    summarise,
)
from uasthn_cli.types import FloatArray


def ramp_sample(H_thermal_satellite: FloatArray, thermal_px: int, size_px: int) -> MatchSample:
    """Return a sample whose satellite image says where each of its pixels lies."""
    rows, columns = np.mgrid[:size_px, :size_px]
    satellite = np.stack([columns, rows, 0 * rows], axis=-1).astype(np.uint8)
    corners = transform_points(H_thermal_satellite, image_corners_px(thermal_px, thermal_px))
    thermal = np.zeros((thermal_px, thermal_px), np.uint8)
    return MatchSample("ramp", satellite, thermal, corners, 1.0)


@settings(max_examples=30, deadline=None)
@given(
    angle_deg=st.floats(-40, 40),
    scale=st.floats(0.4, 1.4),
    size_px=st.sampled_from([24, 64, 100]),
)
def test_convention_each_pixel_shows_its_place(
    angle_deg: float, scale: float, size_px: int
) -> None:
    thermal_px = 60
    a = np.radians(angle_deg)
    turn = scale * np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    middle = (thermal_px - 1) / 2
    H = np.eye(3)
    H[:2, :2], H[:2, 2] = turn, np.array([100.0, 110.0]) - turn @ [middle, middle]
    aligned = aligned_satellite(ramp_sample(H, thermal_px, 220), size_px)
    rows, columns = np.mgrid[:size_px, :size_px]
    points = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    H_aligned_thermal = resize_homography((size_px, size_px), (thermal_px, thermal_px))
    places = transform_points(H @ H_aligned_thermal, points).reshape(size_px, size_px, 2)
    assert np.abs(aligned[..., :2] - places).max() < 1.1  # rounding of grey levels, twice


def test_an_upright_pair_is_what_the_thermal_image_shows() -> None:
    sample = pair(0)
    red = aligned_satellite(sample, sample.thermal.shape[0])[..., 0].astype(int)
    assert np.abs(255 - red - sample.thermal).max() <= 1


def test_footprint_ends_where_pixels_end() -> None:
    assert footprint_px(pair(0)) == pytest.approx(80)
    assert footprint_px(replace(pair(0), corners_px=image_corners_px(80, 80) * 2)) == pytest.approx(
        160
    )


def test_a_summary_knows_resolution_and_content() -> None:
    summary = summarise(listed_pairs(3), 64)
    assert summary.pairs == 3
    assert summary.gsd_m == pytest.approx(80 * 2.0 / 64)
    assert summarise(listed_pairs(3), 64) == summary
    other = ListedPairs([*listed_pairs(2).samples, replace(pair(2), thermal=pair(3).thermal)])
    assert summarise(other, 64).fingerprint != summary.fingerprint


def test_nothing_to_learn_from_is_said() -> None:
    with pytest.raises(TrainingDataError, match="holds no pair"):
        summarise(ListedPairs([]), 64)


def test_corners_without_area_name_the_sample() -> None:
    sample = replace(pair(4), corners_px=np.full((4, 2), 5.0))
    with pytest.raises(TrainingDataError, match="pair 4: its corners enclose no area"):
        aligned_satellite(sample, 32)


def batches(seed: int = 0, batch: int = 1, jitter_px: int = 0) -> PairBatches:
    return PairBatches(listed_pairs(5), batch=batch, size_px=64, jitter_px=jitter_px, seed=seed)


def test_a_pass_shows_every_pair_once_in_an_order_of_its_own() -> None:
    def means(first: int, seed: int = 0) -> list[float]:
        return [float(batches(seed)[first + k].thermal.mean()) for k in range(5)]

    assert len({round(mean, 4) for mean in means(0)}) == 5
    assert sorted(means(0)) == pytest.approx(sorted(means(5)))
    orders = {tuple(np.argsort(means(5 * epoch))) for epoch in range(4)}
    assert len(orders) > 1


def test_batches_depend_on_seed_and_number_alone() -> None:
    first, same, other = batches(0, 3, 6)[7], batches(0, 3, 6)[7], batches(1, 3, 6)[7]
    assert first.satellite.shape == (3, 3, 64, 64)
    assert first.thermal.shape == (3, 1, 64, 64)
    assert all((a == b).all() for a, b in zip(first, same, strict=True))
    assert not (first.thermal == other.thermal).all()


def test_both_images_are_mirrored_and_shifted_together() -> None:
    mirrored = set()
    for number in range(12):
        satellite, thermal = batches(2, 1, 10)[number]
        assert (satellite[0, 0] + thermal[0, 0]).abs().mean() < 0.02
        mirrored.add(bool(satellite[0, 0, 0, 0] > satellite[0, 0, 0, -1]))
    assert mirrored == {True, False}


def test_grey_levels_survive_the_way_to_the_network_and_back() -> None:
    levels = np.arange(256, dtype=np.uint8).reshape(1, 8, 32, 1)
    values = as_tensor(levels)
    assert (values.min().item(), values.max().item()) == (-1, 1)
    assert (grey_levels(values)[0, 0] == levels[0, ..., 0]).all()


def test_thermal_images_are_averaged_when_made_smaller() -> None:
    checks = (np.indices((64, 64)).sum(axis=0) % 2 * 255).astype(np.uint8)
    assert np.ptp(resized_thermal(checks, 32)) == 0
    assert resized_thermal(checks, 96).shape == (96, 96)
