"""Fixtures that several rooms share."""

import logging
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from uasthn_cli.pipeline import parallel

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

os.environ["UASTHN_CACHE"] = "none"  # no test finds, or leaves, features in the user's own folder


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """Return the folder of real data beside the repository, or skip the test where it is absent."""
    folder = Path(__file__).parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip("../shared is not here")
    return folder


@pytest.fixture
def can_fork(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let several processes work although other tests have loaded torch, which these do not use."""
    monkeypatch.setattr(parallel, "can_fork", lambda: sys.platform == "linux")


@pytest.fixture(autouse=True)
def _unchanged_logging() -> Iterator[None]:
    """Undo what a command does to the package's logger, so that tests do not hear each other."""
    logger = logging.getLogger("uasthn_cli")
    handlers, level = logger.handlers, logger.level
    yield
    logger.handlers = handlers
    logger.setLevel(level)
