"""The homography consensus: what follows one homography agrees, and the paper's equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from uasthn_cli.config import Aggregation, CropTtaConfig, UeMethod
from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    homography_from_corners,
    image_corners_px,
    transform_points,
)
from uasthn_cli.types import FloatArray
from uasthn_cli.uncertainty.consensus import recover_corners, spread_of_frame
from uasthn_cli.uncertainty.methods import UncertaintyChoice
from uasthn_cli.uncertainty.views import crop_views_px

WIDTH_PX, HEIGHT_PX = 160, 110
CROPS_BY = {kind: UncertaintyChoice(aggregation=kind) for kind in Aggregation}
ORIGINAL = CROPS_BY[Aggregation.ORIGINAL]
CORNER_NOISE = arrays.arrays(np.float64, (4, 2), elements=st.floats(-25.0, 25.0))
SHIFT = arrays.arrays(np.float64, (2,), elements=st.floats(-300.0, 300.0))
CROPS = st.builds(
    CropTtaConfig,
    views=st.integers(1, 7),
    offset_fraction=st.floats(0.02, 0.6),
    seed=st.integers(0, 1000),
)


def dlt(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the homography between corners as the null vector of the DLT equations."""
    rows = []
    for (x, y), (u, v) in zip(before, after, strict=True):
        rows.append([x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y, -u])
        rows.append([0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y, -v])
    H: FloatArray = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)
    return H


def homogeneous(points: FloatArray) -> FloatArray:
    """Return points ``(4, 2)`` as columns ``(3, 4)``."""
    columns: FloatArray = np.vstack([points.T, np.ones(len(points))])
    return columns


@given(crops=CROPS, noise=CORNER_NOISE, shift=SHIFT)
def test_views_that_follow_one_homography_agree(
    crops: CropTtaConfig, noise: FloatArray, shift: FloatArray
) -> None:
    full = image_corners_px(WIDTH_PX, HEIGHT_PX)
    expected = full + noise + shift
    views = crop_views_px(WIDTH_PX, HEIGHT_PX, crops, "frame.png")
    found = transform_points(homography_from_corners(full, expected), views)
    for aggregation in Aggregation:
        spread = spread_of_frame(views, found, CROPS_BY[aggregation])
        assert spread.recovered_px == pytest.approx(
            np.broadcast_to(expected, views.shape), abs=1e-6
        )
        assert spread.corners_px == pytest.approx(expected, abs=1e-6)
        assert spread.std_px == pytest.approx(np.zeros((4, 2)), abs=1e-6)


@given(crops=CROPS, noise=arrays.arrays(np.float64, (7, 4, 2), elements=st.floats(-6.0, 6.0)))
def test_recovery_is_what_the_papers_equations_say(crops: CropTtaConfig, noise: FloatArray) -> None:
    """Sec. III-B, eqs. 1-5, with the paper's names: hats are corners before the homography."""
    views = crop_views_px(WIDTH_PX, HEIGHT_PX, crops, "frame.png")
    found = views + noise[: len(views)]
    x_RS = image_corners_px(256, 256)
    x_hat_RT = views[0]
    recovered = recover_corners(views, found)
    for i, (x_hat_RCT, x_RCT) in enumerate(zip(views, found, strict=True)):
        D_RS_RCT = x_RCT - x_RS
        H_RS_RT = dlt(x_hat_RCT, x_RCT)
        H_RCT_RT = dlt(x_hat_RCT, x_hat_RT)
        mapped = H_RS_RT @ H_RCT_RT @ np.linalg.inv(H_RS_RT) @ homogeneous(x_RS + D_RS_RCT)
        x_RT = (mapped[:2] / mapped[2]).T
        D_RS_RT = x_RT - x_RS
        assert recovered[i] - x_RS == pytest.approx(D_RS_RT, abs=1e-4)


def test_view_zero_is_its_own_answer() -> None:
    views = crop_views_px(WIDTH_PX, HEIGHT_PX, CropTtaConfig(), "frame.png")
    found = views + np.random.default_rng(0).normal(0.0, 4.0, views.shape)
    spread = spread_of_frame(views, found, ORIGINAL)
    assert spread.corners_px == pytest.approx(found[0])


def test_the_mean_is_over_all_recovered_views() -> None:
    views = crop_views_px(WIDTH_PX, HEIGHT_PX, CropTtaConfig(), "frame.png")
    found = views + np.random.default_rng(1).normal(0.0, 4.0, views.shape)
    spread = spread_of_frame(views, found, CROPS_BY[Aggregation.MEAN])
    assert spread.corners_px == pytest.approx(spread.recovered_px.mean(axis=0))
    assert not np.allclose(spread.corners_px, found[0])


def test_views_that_disagree_by_a_shift_spread_by_it() -> None:
    views = np.stack([image_corners_px(WIDTH_PX, HEIGHT_PX)] * 3)
    found = views + np.array([[0.0, 0.0], [3.0, 0.0], [6.0, 12.0]])[:, None]
    spread = spread_of_frame(views, found, ORIGINAL)
    expected = [np.std([0, 3, 6], ddof=1), np.std([0, 0, 12], ddof=1)]
    assert spread.std_px == pytest.approx(np.array([expected] * 4))


def test_a_single_view_has_no_spread() -> None:
    views = image_corners_px(WIDTH_PX, HEIGHT_PX)[None]
    spread = spread_of_frame(views, views + 5.0, ORIGINAL)
    assert (spread.std_px == 0).all()


def test_a_small_crops_error_grows_with_the_frame() -> None:
    full, crop = image_corners_px(160, 110), image_corners_px(80, 55)
    views = np.stack([full, crop])
    found = np.stack([full, crop * 1.1])
    spread = spread_of_frame(views, found, ORIGINAL)
    assert spread.recovered_px[1] == pytest.approx(full * 1.1)
    assert spread.std_px[3] == pytest.approx(0.1 * full[3] / np.sqrt(2))


def test_further_members_add_their_answers_for_the_whole_frame() -> None:
    views = np.stack([image_corners_px(WIDTH_PX, HEIGHT_PX)] * 2)
    members = views + np.array([[6.0, 0.0], [0.0, 3.0]])[:, None]
    choice = UncertaintyChoice(UeMethod.DE, aggregation=Aggregation.MEAN)
    spread = spread_of_frame(views, views, choice, members=members)
    expected = [np.std([0, 6, 0], ddof=1), np.std([0, 0, 3], ddof=1)]
    assert spread.std_px == pytest.approx(np.array([expected] * 4))
    assert spread.corners_px == pytest.approx(views[0] + [2.0, 1.0])


def test_what_the_network_says_of_itself_is_taken_as_it_is() -> None:
    views = image_corners_px(WIDTH_PX, HEIGHT_PX)[None]
    stated = np.arange(8.0).reshape(4, 2)
    spread = spread_of_frame(views, views, UncertaintyChoice(UeMethod.DM), modelled_std=stated)
    assert spread.std_px == pytest.approx(stated)


def test_a_view_without_homography_is_an_error() -> None:
    views = crop_views_px(WIDTH_PX, HEIGHT_PX, CropTtaConfig(), "frame.png")
    found = views.copy()
    found[2, 3] = found[2, 0]
    with pytest.raises(DegenerateHomographyError):
        spread_of_frame(views, found, ORIGINAL)
