"""Time is counted once, in the innermost stage; a clock that the test sets."""

import time

import pytest

from uasthn_cli.pipeline.timing import StageTimer


class Clock:
    """Stands in for ``time.perf_counter``."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, "perf_counter", clock)
    return clock


def test_repeated_stages_add_up(clock: Clock) -> None:
    timer = StageTimer()
    for seconds in (2.0, 3.5):
        with timer.stage("decode"):
            clock.now_s += seconds
        clock.now_s += 10.0
    assert timer.seconds == {"decode": 5.5}


def test_a_nested_stage_does_not_count_in_the_outer_one(clock: Clock) -> None:
    timer = StageTimer()
    with timer.stage("map"):
        clock.now_s += 1.0
        with timer.stage("features"):
            clock.now_s += 4.0
            with timer.stage("read"):
                clock.now_s += 0.5
        with timer.stage("features"):
            clock.now_s += 2.0
        clock.now_s += 0.25
    assert timer.seconds == {"map": 1.25, "features": 6.0, "read": 0.5}


def test_a_stage_that_fails_is_counted_and_closed(clock: Clock) -> None:
    timer = StageTimer()
    with timer.stage("map"):
        with pytest.raises(ValueError, match="torn"), timer.stage("read"):
            clock.now_s += 3.0
            raise ValueError("torn")
        clock.now_s += 1.0
    assert timer.seconds == {"map": 1.0, "read": 3.0}


def test_a_timed_function_is_the_function(clock: Clock) -> None:
    timer = StageTimer()

    def slow(value: int, *, plus: int) -> int:
        clock.now_s += 2.0
        return value + plus

    timed = timer.timed("sum", slow)
    assert timed(1, plus=2) == 3
    assert timer.seconds == {"sum": 2.0}


def test_what_other_processes_spent_is_added(clock: Clock) -> None:
    timer = StageTimer()
    with timer.stage("search"):
        clock.now_s += 1.0
        timer.add({"search": 4.0, "decode": 0.5})
    assert timer.seconds == {"search": 5.0, "decode": 0.5}
