from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from known_estimator import made_up_predictions

from uasthn_cli.config import Aggregation, DecisionConfig, Merge, Rule, UeMethod
from uasthn_cli.errors import PredictionsError
from uasthn_cli.evaluation.judging import (
    JudgingConfig,
    centre_errors_m,
    image_centres_px,
    judge,
    mean_corner_errors_m,
)
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px, transform_points
from uasthn_cli.types import FloatArray

ERRORS_M = np.array([2.0, 5.0, 60.0, 90.0])
STD_M = np.array([1.0, 12.0, 8.0, 30.0])


def threshold(limit_m: float, rule: Rule = Rule.ALL) -> JudgingConfig:
    return JudgingConfig(DecisionConfig(max_std_m=limit_m, rule=rule))


def test_errors_and_deviations_are_those_that_were_put_in() -> None:
    some = made_up_predictions(ERRORS_M, STD_M, members=3)
    judged = judge(some, UeMethod.CROPTTA, threshold(10.0))
    np.testing.assert_allclose(judged.mace_m, ERRORS_M)
    np.testing.assert_allclose(judged.ce_m, ERRORS_M)
    np.testing.assert_allclose(judged.uncertainty_m, STD_M)
    assert judged.accepted.tolist() == [True, False, True, False]
    ensemble = judge(some, UeMethod.DE, threshold(10.0))
    np.testing.assert_allclose(ensemble.uncertainty_m, 2.0 * STD_M)
    np.testing.assert_allclose(ensemble.mace_m, ERRORS_M)
    for merge, factor in ((Merge.MAX, 2.0), (Merge.MIN, 1.0), (Merge.ADD, 3.0)):
        both = judge(some, UeMethod.CROPTTA_DE, replace(threshold(10.0), merge=merge))
        np.testing.assert_allclose(both.uncertainty_m, factor * STD_M)


def test_without_a_method_everything_is_accepted() -> None:
    judged = judge(made_up_predictions(ERRORS_M, STD_M), UeMethod.NONE, threshold(1e-9))
    assert judged.accepted.all()
    assert not judged.uncertainty_m.any()


def test_a_threshold_in_pixels_is_of_w_r_across_the_window() -> None:
    some = made_up_predictions(ERRORS_M, STD_M)  # windows of 160 px of 2 m
    in_px = JudgingConfig(DecisionConfig(max_std_px=10.0 * 256 / 320))
    assert judge(some, UeMethod.CROPTTA, in_px).accepted.tolist() == [True, False, True, False]


def test_one_corner_is_enough_for_any_and_not_for_all() -> None:
    some = made_up_predictions(ERRORS_M[:1], STD_M[:1])
    some.answers_px[0, 0, 1, 2, 0] += 500.0
    assert judge(some, UeMethod.CROPTTA, threshold(10.0)).accepted.all()
    assert not judge(some, UeMethod.CROPTTA, threshold(10.0, Rule.ANY)).accepted.any()


def test_aggregation_decides_whose_answer_it_is() -> None:
    some = made_up_predictions(ERRORS_M, STD_M, members=3)
    some.answers_px[:, 1, 0] += 30.0
    some.answers_px[:, 0, 1] += 30.0
    config = threshold(10.0)
    original = {m: judge(some, m, replace(config, aggregation=Aggregation.ORIGINAL)) for m in UE}
    mean = {m: judge(some, m, replace(config, aggregation=Aggregation.MEAN)) for m in UE}
    chosen = {m: judge(some, m, config) for m in UE}
    np.testing.assert_array_equal(
        chosen[UeMethod.CROPTTA].mace_m, original[UeMethod.CROPTTA].mace_m
    )
    np.testing.assert_array_equal(chosen[UeMethod.DE].mace_m, mean[UeMethod.DE].mace_m)
    np.testing.assert_allclose(original[UeMethod.DE].mace_m, ERRORS_M)
    for method in UE:
        assert (np.abs(original[method].mace_m - mean[method].mace_m) > 0.1).all()


UE = (UeMethod.CROPTTA, UeMethod.DE, UeMethod.CROPTTA_DE)


def test_a_sample_without_an_answer_has_the_prior_s_error_and_is_not_accepted() -> None:
    some = made_up_predictions(ERRORS_M, STD_M)
    some.answers_px[0, 0, 0] = np.nan
    judged = judge(some, UeMethod.CROPTTA, threshold(1e9))
    assert judged.accepted.tolist() == [False, True, True, True]
    assert judged.answered.tolist() == [False, True, True, True]
    assert judged.uncertainty_m[0] == np.inf
    prior_error_m = 2.0 * np.hypot(90.0 - 79.5, 70.0 - 79.5)
    np.testing.assert_allclose(judged.mace_m[0], prior_error_m)


def test_a_crop_without_an_answer_is_reason_enough_to_reject() -> None:
    some = made_up_predictions(ERRORS_M, STD_M)
    some.answers_px[1, 0, 3] = np.nan
    judged = judge(some, UeMethod.CROPTTA, threshold(1e9))
    assert judged.accepted.tolist() == [True, False, True, True]
    np.testing.assert_allclose(judged.mace_m, ERRORS_M)


@pytest.mark.parametrize(
    ("method", "message"),
    [
        (UeMethod.CROPTTA, "needs crops, say --views 5"),
        (UeMethod.DE, "needs an ensemble: give --weights several times"),
        (UeMethod.CROPTTA_DE, "needs crops"),
        (UeMethod.DM, "needs a network with a second head; known has none"),
    ],
)
def test_what_predictions_do_not_allow_is_refused(method: UeMethod, message: str) -> None:
    some = made_up_predictions(ERRORS_M, STD_M, views=1)
    with pytest.raises(PredictionsError, match=message):
        judge(some, method, JudgingConfig())


def test_what_a_network_says_of_itself_is_direct_modeling() -> None:
    some = made_up_predictions(ERRORS_M, STD_M)
    modelled = replace(some, modelled_std_px=np.full((4, 4, 2), 3.0))
    judged = judge(modelled, UeMethod.DM, threshold(5.0))
    np.testing.assert_allclose(judged.uncertainty_m, 6.0)
    assert not judged.accepted.any()


@given(
    arrays(np.float64, (3, 4, 2), elements=st.floats(-20.0, 20.0)),
    st.floats(0.1, 10.0),
)
def test_a_homography_carries_the_centre_along(noise: FloatArray, gsd_m: float) -> None:
    square = image_corners_px(101, 101)
    corners = square + noise
    H = homography_from_corners(square, corners)
    expected = transform_points(H, np.full((3, 1, 2), 50.0))[:, 0]
    np.testing.assert_allclose(image_centres_px(corners), expected, atol=1e-6)
    same = np.broadcast_to(square, corners.shape)
    ce_m = centre_errors_m(corners, same, np.full(3, gsd_m))
    np.testing.assert_allclose(ce_m, np.linalg.norm(expected - 50.0, axis=1) * gsd_m, atol=1e-5)


@given(arrays(np.float64, (2, 4, 2), elements=st.floats(-1e3, 1e3)), st.floats(-500.0, 500.0))
def test_a_shift_is_its_own_mean_corner_error(corners: FloatArray, shift: float) -> None:
    moved = corners + np.array([shift, 0.0])
    found = mean_corner_errors_m(moved, corners, np.array([1.0, 2.0]))
    np.testing.assert_allclose(found, np.abs(shift) * np.array([1.0, 2.0]), atol=1e-9)


def test_corners_on_a_line_have_their_mean_as_centre() -> None:
    line = np.array([[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [5.0, 0.0]]])
    np.testing.assert_allclose(image_centres_px(line), [[2.0, 0.0]])
