"""What each method of uncertainty estimation needs, and what it makes of answers."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from uasthn_cli.config import Aggregation, Merge, UeMethod
from uasthn_cli.types import FloatArray
from uasthn_cli.uncertainty.methods import (
    Offer,
    UncertaintyChoice,
    frame_corners,
    frame_std,
    paper_aggregation,
    refusal,
    richest_method,
)

OFFERS = st.builds(Offer, st.just("ihn"), st.integers(1, 6), st.integers(1, 4), st.booleans())


@given(OFFERS)
def test_the_richest_method_can_be_had_and_leaves_nothing_but_a_head_unused(offer: Offer) -> None:
    method = richest_method(offer)
    assert refusal(method, offer) is None
    assert ("croptta" in method) == (offer.views > 1)
    assert (method.split("+")[-1] == "de") == (offer.members > 1)
    assert (method is UeMethod.DM) == (offer.views == offer.members == 1 and offer.has_head)


@pytest.mark.parametrize(
    ("method", "why"),
    [
        (UeMethod.CROPTTA, "croptta needs crops, say --views 5"),
        (UeMethod.DE, "de needs an ensemble: give --weights several times"),
        (UeMethod.CROPTTA_DE, "needs crops"),
        (UeMethod.DM, "dm needs a network with a second head; ihn has none"),
    ],
)
def test_what_is_not_there_is_named(method: UeMethod, why: str) -> None:
    assert why in str(refusal(method, Offer("ihn", 1, 1, False)))
    assert refusal(method, Offer("ihn", 5, 3, True)) is None
    assert refusal(UeMethod.NONE, Offer("ihn", 1, 1, False)) is None


def test_only_xcorr_is_told_of_the_ensemble_in_the_box() -> None:
    told = [refusal(UeMethod.DE, Offer("ihn", 5, 1, False, box)) for box in (True, False)]
    assert ["--ensemble" in str(why) for why in told] == [True, False]


def test_the_paper_takes_the_mean_of_an_ensemble_only() -> None:
    of_mean = [m for m in UeMethod if paper_aggregation(m) is Aggregation.MEAN]
    assert of_mean == [UeMethod.DE, UeMethod.CROPTTA_DE]


@given(arrays(np.float64, (3, 5, 4, 2), elements=st.floats(-1e3, 1e3)))
def test_each_method_looks_at_its_own_answers(answers: FloatArray) -> None:
    crops, members = answers[0].std(axis=0, ddof=1), answers[:, 0].std(axis=0, ddof=1)
    stated = np.full((4, 2), 3.0)
    expected = {
        (UeMethod.NONE, Merge.MAX): np.zeros((4, 2)),
        (UeMethod.DM, Merge.MAX): stated,
        (UeMethod.CROPTTA, Merge.MAX): crops,
        (UeMethod.DE, Merge.MAX): members,
        (UeMethod.CROPTTA_DE, Merge.MAX): np.maximum(crops, members),
        (UeMethod.CROPTTA_DE, Merge.MIN): np.minimum(crops, members),
        (UeMethod.CROPTTA_DE, Merge.ADD): crops + members,
    }
    for (method, merge), std in expected.items():
        found = frame_std(answers, stated, UncertaintyChoice(method, merge))
        np.testing.assert_allclose(found, std, atol=1e-9)


@given(arrays(np.float64, (3, 5, 4, 2), elements=st.floats(-1e3, 1e3)))
def test_each_method_answers_by_its_own_answers(answers: FloatArray) -> None:
    mean = {
        UeMethod.CROPTTA: answers[0].mean(axis=0),
        UeMethod.DE: answers[:, 0].mean(axis=0),
        UeMethod.CROPTTA_DE: answers[:, 0].mean(axis=0),
    }
    for method, aggregation in product(UeMethod, Aggregation):
        found = frame_corners(answers, UncertaintyChoice(method, Merge.MAX, aggregation))
        is_mean = aggregation is Aggregation.MEAN
        expected = mean.get(method, answers[0, 0]) if is_mean else answers[0, 0]
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_network_that_says_nothing_is_not_taken_for_sure() -> None:
    with pytest.raises(ValueError, match="says nothing of its error"):
        frame_std(np.zeros((1, 1, 4, 2)), None, UncertaintyChoice(UeMethod.DM))
