"""95 % intervals against SciPy's own, and against samples whose truth is known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest, bootstrap, ttest_1samp

from uasthn_cli.report.intervals import (
    mean_interval,
    quantile_interval,
    rms_interval,
    share_intervals,
    wilson_interval,
)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_is_that_of_scipy(share: tuple[int, int]) -> None:
    expected = binomtest(*share).proportion_ci(0.95, method="wilson")
    assert wilson_interval(*share) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_shares_of_nothing_have_no_interval() -> None:
    flags = np.array([True, False, True])
    found = share_intervals(some=flags, none=flags[:0])
    assert found == {"some": wilson_interval(2, 3)}


@given(count=st.integers(1, 300), quantile=st.sampled_from([0.5, 0.9]))
def test_order_statistics_are_the_nearest_that_leave_2_5_percent_on_either_side(
    count: int, quantile: float
) -> None:
    """Errors 1 … n: an end of the interval is the rank of its order statistic."""
    low, high = quantile_interval(np.arange(1.0, count + 1.0)[::-1], quantile)
    below = binom(count, quantile)
    if low:
        assert below.cdf(low - 1) <= 0.025
    assert below.cdf(low) > 0.025  # the next one would leave more
    if high is None:
        assert below.sf(count - 1) > 0.025
    else:
        assert below.sf(high - 1) <= 0.025 < below.sf(high - 2)


def test_few_errors_say_nothing_about_the_largest() -> None:
    low, high = quantile_interval(np.arange(1.0, 21.0), 0.9)
    assert (low, high) == (15.0, None)
    assert quantile_interval(np.array([4.0]), 0.5) == (0.0, None)


def test_the_interval_of_a_mean_is_students() -> None:
    values = np.array([2.0, 3.5, 1.0, 6.0, 4.0])
    expected = ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert mean_interval(values) == pytest.approx((expected.low, expected.high))
    assert mean_interval(np.array([0.1, 9.0]))[0] == 0.0  # type: ignore[index]
    assert mean_interval(values[:1]) is rms_interval(values[:1]) is None


def test_the_interval_of_an_rmse_is_about_that_of_a_bootstrap() -> None:
    errors = np.random.default_rng(5).rayleigh(4.0, 200)
    expected = bootstrap(
        (errors,), lambda x, axis: np.sqrt((x**2).mean(axis=axis)), method="percentile", rng=1
    ).confidence_interval
    found = rms_interval(errors)
    assert found == pytest.approx((expected.low, expected.high), rel=0.02)
    assert found is not None
    assert found[0] < math.sqrt(float(np.mean(errors**2))) < found[1]
