"""What a person sees while a command runs: log lines and progress, all on stderr.

The level of the package's logger is the one record of how talkative the program is.
"""

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

PACKAGE_LOGGER = logging.getLogger("uasthn_cli")
_PLAIN_LINES = 10


class Verbosity(IntEnum):
    """How much is said on stderr, as a level of :mod:`logging`."""

    QUIET = logging.ERROR
    NORMAL = logging.WARNING
    VERBOSE = logging.INFO
    DEBUG = logging.DEBUG


class _StderrHandler(logging.Handler):
    """Write records to whatever stderr is now, so that a live progress bar stays below them."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        _write(self.format(record))


class _LineFormatter(logging.Formatter):
    """``uasthn: warning: …``; below a warning the level goes unsaid."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as one line, followed by its traceback if it has one."""
        level = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        return f"uasthn: {level}{super().format(record)}"


def set_verbosity(verbosity: Verbosity) -> None:
    """Send the package's log records of this level and above to stderr."""
    handler = _StderrHandler()
    handler.setFormatter(_LineFormatter())
    PACKAGE_LOGGER.handlers = [handler]
    PACKAGE_LOGGER.setLevel(verbosity)
    logging.captureWarnings(True)
    third_party = logging.getLogger("py.warnings")
    third_party.handlers = [handler]
    third_party.setLevel(logging.ERROR if verbosity > Verbosity.VERBOSE else logging.WARNING)


def _write(line: str) -> None:
    """Write a line to stderr: not by click, which would write past a live bar's own stream."""
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def is_quiet() -> bool:
    """Tell whether only errors are to be said."""
    return PACKAGE_LOGGER.level >= Verbosity.QUIET


def say(line: str) -> None:
    """Print one line for a person on stderr, unless ``--quiet``."""
    if not is_quiet():
        _write(line)


@contextmanager
def progress(
    description: str, total: int, done: int = 0, *, plain_lines: bool = True
) -> Iterator[Callable[[int], None]]:
    """Show how far a job of ``total`` steps is; yields a function that takes the steps done so far.

    A bar on a terminal; elsewhere a plain line at every tenth, unless the job has lines of its own
    (``plain_lines=False``); nothing with ``--quiet``.
    """
    console = Console(stderr=True)
    if is_quiet() or not (console.is_interactive or plain_lines):
        yield lambda _: None
    elif console.is_interactive:
        columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
        with Progress(*columns, TimeRemainingColumn(), console=console) as bar:
            task = bar.add_task(description, total=total, completed=done)
            yield lambda steps: bar.update(task, completed=steps)
    else:
        yield _plain_lines(description, total, done)


def _plain_lines(description: str, total: int, done: int) -> Callable[[int], None]:
    """Return a function that prints a line whenever another tenth of ``total`` is done."""
    printed = [done * _PLAIN_LINES // max(total, 1)]

    def advance(steps: int) -> None:
        tenth = steps * _PLAIN_LINES // max(total, 1)
        if tenth > printed[0]:
            printed[0] = tenth
            _write(f"{description}: {steps} of {total}")

    return advance
