import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from uasthn_cli.config import Aggregation, Merge
from uasthn_cli.types import FloatArray
from uasthn_cli.uncertainty.consensus import spread_of_frame
from uasthn_cli.uncertainty.merge import (
    crop_corners,
    crop_std,
    ensemble_corners,
    ensemble_std,
    merged_std,
)
from uasthn_cli.uncertainty.methods import UncertaintyChoice

STDS = arrays(np.float64, (4, 2), elements=st.floats(0.0, 1e4))
PLACES = st.floats(-1e3, 1e3)


def answers_of(members: int, views: int) -> st.SearchStrategy[FloatArray]:
    return arrays(np.float64, (members, views, 4, 2), elements=PLACES)


@given(STDS, STDS)
def test_merges_are_ordered_and_do_not_care_which_comes_first(a: FloatArray, b: FloatArray) -> None:
    least, most, total = (merged_std(a, b, merge) for merge in (Merge.MIN, Merge.MAX, Merge.ADD))
    assert (least <= most).all()
    assert (most <= total).all()
    np.testing.assert_allclose(least + most, total)
    for merge in Merge:
        np.testing.assert_array_equal(merged_std(a, b, merge), merged_std(b, a, merge))


@given(STDS)
def test_no_uncertainty_of_the_other_kind_changes_nothing_but_min(std: FloatArray) -> None:
    nothing = np.zeros((4, 2))
    np.testing.assert_array_equal(merged_std(std, nothing, Merge.MAX), std)
    np.testing.assert_array_equal(merged_std(std, nothing, Merge.ADD), std)
    np.testing.assert_array_equal(merged_std(std, nothing, Merge.MIN), nothing)


@given(answers_of(3, 5), st.floats(-500.0, 500.0))
def test_a_shift_of_all_answers_moves_the_corners_and_not_the_deviations(
    answers: FloatArray, shift: float
) -> None:
    moved = answers + shift
    np.testing.assert_allclose(crop_std(moved), crop_std(answers), atol=1e-8)
    np.testing.assert_allclose(ensemble_std(moved), ensemble_std(answers), atol=1e-8)
    for aggregation in Aggregation:
        for corners in (crop_corners, ensemble_corners):
            np.testing.assert_allclose(
                corners(moved, aggregation), corners(answers, aggregation) + shift, atol=1e-8
            )


@given(answers_of(3, 4), st.permutations(range(1, 4)), st.permutations(range(1, 3)))
def test_the_order_of_crops_and_of_further_members_does_not_matter(
    answers: FloatArray, crops: list[int], members: list[int]
) -> None:
    mixed = answers[[0, *members]][:, [0, *crops]]
    np.testing.assert_allclose(crop_std(mixed), crop_std(answers), atol=1e-9)
    np.testing.assert_allclose(ensemble_std(mixed), ensemble_std(answers), atol=1e-9)


@given(answers_of(3, 4))
def test_what_the_members_did_not_see_does_not_matter(answers: FloatArray) -> None:
    asked = answers.copy()
    asked[1:, 1:] = np.nan
    np.testing.assert_array_equal(crop_std(asked), crop_std(answers))
    np.testing.assert_array_equal(ensemble_std(asked), ensemble_std(answers))


@given(answers_of(1, 1))
def test_one_answer_is_certain_of_itself(answers: FloatArray) -> None:
    assert not crop_std(answers).any()
    assert not ensemble_std(answers).any()
    np.testing.assert_array_equal(crop_corners(answers, Aggregation.MEAN), answers[0, 0])


@pytest.mark.parametrize("aggregation", list(Aggregation))
def test_views_agree_with_the_consensus_that_geotag_uses(aggregation: Aggregation) -> None:
    rng = np.random.default_rng(3)
    views = np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 7.0], [9.0, 7.0]]) + np.zeros((5, 1, 1))
    found = views + 40.0 + rng.normal(size=(5, 4, 2))
    spread = spread_of_frame(views, found, UncertaintyChoice(aggregation=aggregation))
    answers = spread.recovered_px[None]
    np.testing.assert_allclose(crop_std(answers), spread.std_px)
    np.testing.assert_allclose(crop_corners(answers, aggregation), spread.corners_px)


def test_many_frames_are_merged_at_once() -> None:
    answers = np.random.default_rng(1).normal(size=(6, 3, 5, 4, 2))
    np.testing.assert_allclose(crop_std(answers)[2], crop_std(answers[2]))
    np.testing.assert_allclose(ensemble_std(answers)[2], ensemble_std(answers[2]))
