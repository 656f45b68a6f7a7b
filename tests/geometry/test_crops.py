"""Places of CropTTA's crops."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.config import Sampling
from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.geometry.crops import crop_corners_px


@given(
    st.integers(2, 12),
    st.sampled_from(Sampling),
    st.tuples(st.integers(40, 700), st.integers(40, 700)),
    st.floats(0.0, 30.0),
)
def test_convention_crops_are_smaller_by_the_offset_and_inside(
    views: int, sampling: Sampling, size_px: tuple[int, int], offset_px: float
) -> None:
    rng = np.random.default_rng(0)
    corners = crop_corners_px(size_px, views, (offset_px, offset_px), sampling, rng)
    assert corners.shape == (views, 4, 2)
    assert (corners[0] == image_corners_px(*size_px)).all()
    spans = corners[1:, 3] - corners[1:, 0]
    assert spans == pytest.approx(np.broadcast_to(np.array(size_px) - 1 - offset_px, spans.shape))
    assert corners.min() >= 0.0
    assert (corners.max(axis=(0, 1)) <= np.array(size_px) - 1 + 1e-9).all()


def test_five_views_on_a_grid_are_the_papers() -> None:
    rng = np.random.default_rng(0)
    corners = crop_corners_px((256, 256), 5, (16.0, 16.0), Sampling.GRID, rng)
    firsts = {(float(x), float(y)) for x, y in corners[1:, 0]}
    assert firsts == {(0.0, 0.0), (16.0, 0.0), (0.0, 16.0), (16.0, 16.0)}
    assert {float(value) for value in (corners[1:, 3] - corners[1:, 0]).flat} == {239.0}
