"""Likelihoods are rounded once, by no more than is said, and then stay what they are."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.types import LEAST_LOG, LOG_OF_LEVEL, OffsetLikelihood


@given(st.lists(st.floats(-70.0, 0.0), min_size=1, max_size=50))
def test_a_log_likelihood_is_rounded_by_no_more_than_is_said(values: list[float]) -> None:
    exact = np.array([values])
    found = OffsetLikelihood.of(exact, 1.0, np.zeros(2)).log_likelihood
    clipped = np.maximum(exact, LEAST_LOG)
    assert (np.abs(found - clipped) <= 0.031 * np.sqrt(-clipped) + 2.4e-4).all()


def test_what_is_rounded_stays_as_it_is() -> None:
    every_level = np.arange(256, dtype=np.uint8).reshape(16, 16)
    likelihood = OffsetLikelihood(every_level, 1.0, np.zeros(2))
    again = OffsetLikelihood.of(likelihood.log_likelihood, 1.0, np.zeros(2))
    assert again.levels.tolist() == every_level.tolist()
    assert (LOG_OF_LEVEL[0], LOG_OF_LEVEL[-1]) == (0.0, LEAST_LOG)


def test_what_cannot_be_is_as_unlikely_as_can_be() -> None:
    likelihood = OffsetLikelihood.of(np.array([[0.0, -np.inf]]), 1.0, np.zeros(2))
    assert likelihood.log_likelihood.tolist() == [[0.0, LEAST_LOG]]
