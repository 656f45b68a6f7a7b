import numpy as np
import pytest
from answer_tables import make_answers
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.calibration.answers import Answers, joined


def numbered(*sizes: int) -> Answers:
    """Return flights of these sizes whose errors number the frames."""
    parts = [make_answers(size, seed=k, flight=k) for k, size in enumerate(sizes)]
    answers = joined(parts)
    answers.error_m[:] = np.arange(len(answers))
    return answers


@given(sizes=st.lists(st.integers(1, 30), min_size=1, max_size=6), seed=st.integers(0, 99))
def test_halves_share_no_frame_and_no_flight_and_lose_nothing(sizes: list[int], seed: int) -> None:
    answers = numbered(*sizes)
    first, second = answers.halves(seed)
    both = np.concatenate([first.error_m, second.error_m])
    assert sorted(both) == list(range(len(answers)))
    if len(sizes) > 1:
        assert not set(first.flight) & set(second.flight)
        assert len(first) and len(second)


def test_halves_depend_on_the_seed_alone() -> None:
    answers = numbered(40)
    assert answers.halves(1)[0].error_m.tolist() == answers.halves(1)[0].error_m.tolist()
    assert answers.halves(1)[0].error_m.tolist() != answers.halves(2)[0].error_m.tolist()
    assert len(answers.halves(1)[0]) == 20


@pytest.mark.parametrize("seed", range(6))
def test_flights_are_dealt_so_that_halves_are_near_in_size(seed: int) -> None:
    first, _ = numbered(10, 10, 10, 10).halves(seed)
    assert len(first) == 20


def test_flights_taken_as_one_are_dealt_frame_by_frame() -> None:
    first, second = numbered(10, 10).as_one_flight().halves(0)
    assert len(first) == len(second) == 10
    assert first.error_m.min() < 10 <= first.error_m.max()


def test_thinning_counts_within_each_flight() -> None:
    assert numbered(5, 4).thinned(3).error_m.tolist() == [0, 3, 5, 8]


def test_no_answer_is_beyond_any_tolerance() -> None:
    answers = numbered(3)
    answers.error_m[:] = [25.0, 25.1, np.nan]
    assert answers.is_error(25.0).tolist() == [False, True, True]
