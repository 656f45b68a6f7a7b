"""Pieces that every source of pairs is made of."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.datasets.windows import evenly


@given(st.integers(1, 200), st.integers(1, 250))
def test_what_is_taken_evenly_is_spread_over_all(length: int, count: int) -> None:
    taken = evenly(np.arange(length), count)
    assert len(taken) == min(length, count)
    gaps = np.diff(taken)
    assert taken[0] == 0
    assert len(taken) == 1 or (taken[-1] == length - 1 and gaps.min() > 0)
    assert len(gaps) == 0 or gaps.max() - gaps.min() <= 2
