"""Training in a test must not change how the whole test process uses memory."""

import pytest


@pytest.fixture(autouse=True)
def _plain_malloc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uasthn_cli.training.tgm.trainee.keep_freed_memory", lambda: None)
