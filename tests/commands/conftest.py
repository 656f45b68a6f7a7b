"""The flight that the command tests share."""

from pathlib import Path

import pytest
from fake_vismatch import pretend_installed
from small_flight import Flight, make_flight


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    """Return a new flight of four frames that a test may damage."""
    return make_flight(tmp_path / "flight", count=4)


@pytest.fixture
def fake_vismatch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package that looks like vismatch."""
    pretend_installed(monkeypatch)
