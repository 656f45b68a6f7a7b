"""Frames handed to several threads at once, results taken back in order.

The work lies in libraries that let other threads run meanwhile, each of them on one core, so
threads are as fast as processes would be, start at once and share the map's features. What a frame
gives does not depend on the others: results are the same bytes for any number of jobs.
"""

import math
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Final, TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")

_AHEAD_PER_JOB: Final = 2
"""Frames waiting for a thread: enough to keep it busy, few enough to keep memory flat."""

_QUOTA_V2: Final = Path("/sys/fs/cgroup/cpu.max")
_QUOTA_V1: Final = Path("/sys/fs/cgroup/cpu/cpu.cfs_quota_us")
_PERIOD_V1: Final = Path("/sys/fs/cgroup/cpu/cpu.cfs_period_us")


def usable_cores() -> int:
    """Return how many cores this process may keep busy: by affinity and by a container's quota."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    quota = _container_quota()
    return cores if quota is None else max(1, min(cores, math.floor(quota)))


def in_order(function: Callable[[_T], _R], items: Iterable[_T], jobs: int) -> Iterator[_R]:
    """Yield ``function`` of each item, in order, computed by ``jobs`` threads (1: by this one).

    When the caller stops early, by an exception or Ctrl-C, nothing further is begun.
    """
    if jobs <= 1:
        yield from map(function, items)
        return
    pool = ThreadPoolExecutor(jobs, thread_name_prefix="frame")
    waiting: deque[Future[_R]] = deque()
    try:
        for item in items:
            waiting.append(pool.submit(function, item))
            if len(waiting) >= _AHEAD_PER_JOB * jobs:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


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
