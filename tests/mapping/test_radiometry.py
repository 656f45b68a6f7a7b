"""Samples are bounded and even; values and statistics follow their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.mapping.radiometry import Scaling, find_scaling, find_statistics, sample_boxes
from uasthn_cli.types import GridBox

sides = st.integers(1, 200_000)


@given(st.integers(-1000, 1000), st.integers(-1000, 1000), sides, sides, st.floats(0.01, 1e4))
def test_samples_are_bounded_and_stay_inside(
    column_px: int, row_px: int, width_px: int, height_px: int, source_px_per_px: float
) -> None:
    area = GridBox(column_px, row_px, width_px, height_px)
    boxes = list(sample_boxes(area, source_px_per_px))
    read_px = sum(box.width_px * box.height_px for box in boxes)
    assert 0 < read_px <= 2**21
    assert read_px * source_px_per_px <= max(2**26, 256 * source_px_per_px)
    assert min(box.column_px for box in boxes) == column_px
    assert min(box.row_px for box in boxes) == row_px
    assert max(box.column_px + box.width_px for box in boxes) == column_px + width_px
    assert max(box.row_px + box.height_px for box in boxes) == row_px + height_px


def test_a_small_area_is_covered_once() -> None:
    covered = np.zeros((700, 1100), dtype=int)
    for box in sample_boxes(GridBox(10, -20, 1100, 700), 1.0):
        left, top = box.column_px - 10, box.row_px + 20
        covered[top : top + box.height_px, left : left + box.width_px] += 1
    assert (covered == 1).all()


def test_values_are_scaled_and_clipped() -> None:
    raw = np.array([90.0, 100.0, 150.0, 300.0], dtype=np.float32)
    np.testing.assert_allclose(Scaling(100.0, 300.0).apply(raw), [0.0, 0.0, 0.25, 1.0])


def test_outliers_do_not_set_the_scale() -> None:
    samples = np.linspace(1000, 2000, 3000, dtype=np.float32).reshape(-1, 3)
    samples[0], samples[-1] = -32768, 65535
    scaling = find_scaling("int32", samples, "map.tif")
    assert scaling.low == pytest.approx(1010, abs=2)
    assert scaling.high == pytest.approx(1990, abs=2)
    assert find_scaling("uint8", samples, "map.tif") == Scaling(0.0, 255.0)


def test_without_samples_everything_is_defined() -> None:
    nothing = np.zeros((0, 3), dtype=np.float32)
    assert find_scaling("uint16", nothing, "map.tif") == Scaling(0.0, 1.0)
    assert find_statistics(nothing).deviation == 0.0


def test_deviation_is_the_root_of_the_channels_mean_variance() -> None:
    samples = np.random.default_rng(0).normal(0.5, [0.1, 0.2, 0.05], (50_000, 3))
    statistics = find_statistics(samples.astype(np.float32))
    np.testing.assert_allclose(statistics.mean, 0.5, atol=0.01)
    expected = np.sqrt((0.1**2 + 0.2**2 + 0.05**2) / 3)
    assert statistics.deviation == pytest.approx(expected, rel=0.01)


def test_a_grey_map_has_three_equal_means() -> None:
    grey = np.array([[0.2], [0.6]], dtype=np.float32)
    statistics = find_statistics(grey)
    assert statistics.mean == pytest.approx((0.4, 0.4, 0.4))
    assert statistics.deviation == pytest.approx(0.2)
