"""A package with the interface of huggingface_hub that this project uses, and no network."""

import shutil
import sys
from fnmatch import fnmatch
from pathlib import Path
from types import ModuleType

import pytest


class FakeHub:
    """Repositories by name, each a list of (commit, files), the newest last."""

    def __init__(self) -> None:
        self.repositories: dict[str, list[tuple[str, dict[str, bytes]]]] = {}
        self.is_online = True

    def publish(self, repository: str, commit: str, files: dict[str, bytes]) -> None:
        """Add a commit to a repository."""
        self.repositories.setdefault(repository, []).append((commit, files))

    def snapshot_download(
        self, repo_id: str, *, revision: str, cache_dir: Path, allow_patterns: list[str]
    ) -> str:
        """Return the cache's folder of a commit, as the real client does."""
        snapshots = cache_dir / f"models--{repo_id.replace('/', '--')}" / "snapshots"
        if not self.is_online:
            if (snapshots / revision).is_dir():
                return str(snapshots / revision)
            raise FileNotFoundError("Please check your internet connection\nand try again.")
        commits = dict(self.repositories.get(repo_id, []))
        if revision == "main" and commits:
            revision = list(commits)[-1]
        if revision not in commits:
            raise OSError("404 Client Error: repository or revision not found")
        folder = snapshots / revision
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in commits[revision].items():
            wanted = any(fnmatch(name, pattern) for pattern in allow_patterns)
            if wanted and not (folder / name).exists():
                (folder / name).write_bytes(content)
        return str(folder)


def pretend_hub(monkeypatch: pytest.MonkeyPatch) -> FakeHub:
    """Install the package for one test."""
    hub = FakeHub()
    module = ModuleType("huggingface_hub")
    module.__dict__["snapshot_download"] = hub.snapshot_download
    monkeypatch.setitem(sys.modules, "huggingface_hub", module)
    return hub


def forget(cache_dir: Path) -> None:
    """Delete what was downloaded, not what was recorded of it."""
    shutil.rmtree(cache_dir / "hub")
