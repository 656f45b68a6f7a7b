"""What the tests of matching share."""

import pytest
from fake_vismatch import pretend_installed


@pytest.fixture
def fake_vismatch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package that looks like vismatch."""
    pretend_installed(monkeypatch)
