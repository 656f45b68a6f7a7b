"""Fixtures that several rooms share."""

import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

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


@pytest.fixture(autouse=True)
def _unchanged_logging() -> Iterator[None]:
    """Undo what a command does to the package's logger, so that tests do not hear each other."""
    logger = logging.getLogger("uasthn_cli")
    handlers, level = logger.handlers, logger.level
    yield
    logger.handlers = handlers
    logger.setLevel(level)
