"""Seconds per stage of a run."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")


class StageTimer:
    """Adds up wall-clock time per named stage; nested stages count only once, in the inner one."""

    def __init__(self) -> None:
        """Start with no stage."""
        self.seconds: dict[str, float] = {}
        self._inner_s: list[float] = []  # per open stage, outermost first: spent in stages inside

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time inside the block towards ``name``."""
        started = time.perf_counter()
        self._inner_s.append(0.0)
        try:
            yield
        finally:
            elapsed = time.perf_counter() - started
            self.add({name: elapsed - self._inner_s.pop()})
            if self._inner_s:
                self._inner_s[-1] += elapsed

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add what was spent elsewhere: with several processes the sum may exceed the run."""
        for name, spent_s in seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + spent_s

    def timed(self, name: str, function: Callable[_P, _R]) -> Callable[_P, _R]:
        """Return ``function`` with every call counted towards ``name``."""

        def wrapped(*args: _P.args, **kwargs: _P.kwargs) -> _R:
            with self.stage(name):
                return function(*args, **kwargs)

        return wrapped
