"""Seconds per stage of a run."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")


class _Nesting(threading.local):
    """A thread's open stages, outermost first: how long other stages ran inside each."""

    def __init__(self) -> None:
        self.inner_s: list[float] = []


class StageTimer:
    """Adds up wall-clock time per named stage; nested stages count only once, in the inner one.

    Any thread may enter stages: they nest within their own thread, and the times of all are summed,
    so that together they may be longer than the run.
    """

    def __init__(self) -> None:
        """Start with no stage."""
        self.seconds: dict[str, float] = {}
        self._lock = threading.Lock()
        self._nesting = _Nesting()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time inside the block towards ``name``."""
        inner_s = self._nesting.inner_s
        started = time.perf_counter()
        inner_s.append(0.0)
        try:
            yield
        finally:
            elapsed = time.perf_counter() - started
            own = elapsed - inner_s.pop()
            with self._lock:
                self.seconds[name] = self.seconds.get(name, 0.0) + own
            if inner_s:
                inner_s[-1] += elapsed

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add what another process spent."""
        with self._lock:
            for name, spent_s in seconds.items():
                self.seconds[name] = self.seconds.get(name, 0.0) + spent_s

    def timed(self, name: str, function: Callable[_P, _R]) -> Callable[_P, _R]:
        """Return ``function`` with every call counted towards ``name``."""

        def wrapped(*args: _P.args, **kwargs: _P.kwargs) -> _R:
            with self.stage(name):
                return function(*args, **kwargs)

        return wrapped
