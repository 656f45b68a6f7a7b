"""Frames handed to several processes at once, results taken back in order.

Processes are forked from the one that has everything loaded, so they start at once and share what
is in memory; each works on one core. What a frame gives does not depend on the others: results are
the same bytes for any number of jobs. Threads would wait for one another: between the libraries'
calls lies too much Python.
"""

import ctypes
import math
import multiprocessing
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, Final, TypeVar

import cv2
from threadpoolctl import threadpool_limits

from uasthn_cli.errors import WorkerLostError

_T = TypeVar("_T")
_R = TypeVar("_R")

_STRETCH: Final = 4
"""Frames that a process is given at once: neighbours see the same map."""

_AHEAD_PER_JOB: Final = 2
"""Stretches waiting for a process: enough to keep it busy, few enough to keep memory flat."""

_PR_SET_PDEATHSIG: Final = 1
_QUOTA_V2: Final = Path("/sys/fs/cgroup/cpu.max")
_QUOTA_V1: Final = Path("/sys/fs/cgroup/cpu/cpu.cfs_quota_us")
_PERIOD_V1: Final = Path("/sys/fs/cgroup/cpu/cpu.cfs_period_us")

_functions: dict[int, Callable[[Any], Any]] = {}
"""What forked processes do, by number: they inherit it, for it cannot be sent to them."""


def why_no_fork() -> str | None:
    """Return why there cannot be several processes here; None: there can."""
    if sys.platform != "linux":
        return "elsewhere than on Linux, system libraries do not survive a fork"
    return "torch is loaded, which does not survive a fork" if "torch" in sys.modules else None


def cores_for_jobs() -> int:
    """Return how many processes are worth having: one for each core, where there can be several."""
    return usable_cores() if sys.platform == "linux" else 1


def usable_cores() -> int:
    """Return how many cores this process may keep busy: by affinity and by a container's quota."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    quota = _container_quota()
    return cores if quota is None else max(1, min(cores, math.floor(quota)))


@contextmanager
def one_core_each() -> Iterator[None]:
    """Keep libraries from starting threads of their own: frames are what is shared out.

    The order of sums, and with it the last digits, then depends on nothing but the input.
    """
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        cv2.setNumThreads(before)


def in_order(function: Callable[[_T], _R], items: Iterable[_T], jobs: int) -> Iterator[_R]:
    """Yield ``function`` of each item, in order, computed by ``jobs`` processes (1: by this one).

    Items and results are sent between processes, ``function`` is not. When the caller stops early,
    by an exception or Ctrl-C, nothing further is begun. Several take :func:`why_no_fork` to be
    None.

    Raises:
        WorkerLostError: a process was killed.
    """
    if jobs <= 1:
        yield from map(function, items)
        return
    number = max(_functions, default=0) + 1
    _functions[number] = function
    pool = ProcessPoolExecutor(
        jobs,
        mp_context=multiprocessing.get_context("fork"),
        initializer=_begin,
        initargs=(os.getpid(),),
    )
    waiting: deque[Future[list[_R]]] = deque()
    try:
        for stretch in _stretches(items):
            waiting.append(pool.submit(_compute, number, stretch))
            if len(waiting) >= _AHEAD_PER_JOB * jobs:
                yield from waiting.popleft().result()
        while waiting:
            yield from waiting.popleft().result()
    except BrokenProcessPool as error:
        raise WorkerLostError(
            "a process that looked at frames was killed (too little memory?): finished frames are"
            " kept; give the same command again, with fewer --jobs"
        ) from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        del _functions[number]


def _stretches(items: Iterable[_T]) -> Iterator[list[_T]]:
    iterator = iter(items)
    while stretch := list(islice(iterator, _STRETCH)):
        yield stretch


def _compute(number: int, stretch: list[Any]) -> list[Any]:
    return [_functions[number](item) for item in stretch]


def _begin(parent: int) -> None:
    """Leave Ctrl-C to the process that hands out frames, and end when that one does.

    A terminal sends Ctrl-C to all processes; one that is killed cannot tell its workers.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def _container_quota() -> float | None:
    """Return a control group's limit in cores; None without one."""
    try:
        if _QUOTA_V2.is_file():
            quota, period = _QUOTA_V2.read_text("ascii").split()
        else:
            quota, period = _QUOTA_V1.read_text("ascii"), _PERIOD_V1.read_text("ascii")
        return float(quota) / float(period) if float(quota) > 0 else None
    except (OSError, ValueError):  # no control groups, or "max"
        return None
