"""Packages that offer estimators, as if somebody had installed them."""

from pathlib import Path

import pytest

from uasthn_cli.matching import plugins

EXAMPLE = Path(__file__).parents[2] / "examples" / "estimator_plugin"


def pretend_installed(
    site: Path, monkeypatch: pytest.MonkeyPatch, package: str, points: str, source: str = ""
) -> None:
    """Put a package of one module with entry points (``name = module:attribute``) on the path."""
    module = package.replace("-", "_")
    info = site / f"{module}-0.1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text(f"[uasthn.estimators]\n{points}\n")
    (site / f"{module}.py").write_text(source)
    monkeypatch.syspath_prepend(site)
    plugins._loaded.cache_clear()
