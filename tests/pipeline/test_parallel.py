"""Frames shared out among processes come back in order, whatever becomes of a process."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest

from uasthn_cli.errors import WorkerLostError
from uasthn_cli.pipeline import parallel
from uasthn_cli.pipeline.parallel import in_order, one_core_each, usable_cores

forks = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux alone")


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=forks), pytest.param(3, marks=forks)])
def test_results_come_in_the_order_of_items(jobs: int) -> None:
    assert list(in_order(lambda x: x * x, range(37), jobs)) == [x * x for x in range(37)]


@forks
def test_several_processes_work_and_none_is_this_one() -> None:
    workers = set(in_order(lambda _: os.getpid(), range(64), 2))
    assert os.getpid() not in workers
    assert set(in_order(lambda _: os.getpid(), range(3), 1)) == {os.getpid()}


@forks
def test_few_items_are_taken_ahead() -> None:
    taken = []

    def items() -> Iterator[int]:
        for item in range(1000):
            taken.append(item)
            yield item

    results = in_order(lambda x: x, items(), 2)
    assert next(results) == 0
    assert len(taken) < 50
    results.close()  # type: ignore[attr-defined]


@forks
def test_an_error_in_a_process_is_raised_here() -> None:
    def fail(item: int) -> int:
        if item == 9:
            raise ValueError("nine")
        return item

    with pytest.raises(ValueError, match="nine"):
        list(in_order(fail, range(20), 2))


@forks
def test_a_process_that_is_killed_ends_the_run_in_one_line() -> None:
    def die(item: int) -> int:
        if item == 11:
            os.kill(os.getpid(), signal.SIGKILL)
        return item

    with pytest.raises(WorkerLostError, match="with fewer --jobs"):
        list(in_order(die, range(40), 2))


def test_libraries_start_no_threads_of_their_own_meanwhile() -> None:
    before = cv2.getNumThreads()
    with one_core_each():
        assert cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == before


@pytest.mark.parametrize(
    ("content", "cores"), [("150000 100000", 1), ("300000 100000", 3), ("max 100000", 8)]
)
def test_a_containers_quota_counts(
    content: str, cores: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    quota = tmp_path / "cpu.max"
    quota.write_text(content + "\n")
    monkeypatch.setattr(parallel, "_QUOTA_V2", quota)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    assert usable_cores() == cores
