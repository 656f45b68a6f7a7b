"""Estimators of other packages, found by their entry points; one is loaded when it is asked for."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from uasthn_cli.errors import PluginError, UasthnError
from uasthn_cli.matching.spec import GROUP, EstimatorSpec, Opening
from uasthn_cli.version import HASH_DIGITS, source_sha256

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from uasthn_cli.seam import Estimator


def plugin_names() -> set[str]:
    """Return the names that installed packages offer; none of them is imported."""
    return {point.name for point in _points()}


def require_no_shadow(name: str) -> None:
    """Check that no package offers an estimator under a built-in name.

    Raises:
        PluginError: one does; which of the two is meant cannot be told.
    """
    for point in _points():
        if point.name == name:
            raise PluginError(
                f"{_package(point)} offers an estimator {name!r}, which is a name of uasthn's own:"
                " uninstall it, or have it choose another name"
            )


def plugin_spec(name: str) -> EstimatorSpec | None:
    """Return the estimator that an installed package offers under a name; None: no package does.

    Raises:
        PluginError: the package cannot be imported, offers no :class:`EstimatorSpec`, one of
            another name, or is not the only one.
    """
    points = [point for point in _points() if point.name == name]
    if not points:
        return None
    if len(points) > 1:
        packages = " and ".join(map(_package, points))
        raise PluginError(f"{packages} both offer an estimator {name!r}: uninstall one")
    return _loaded(points[0])


@lru_cache
def _loaded(point: "EntryPoint") -> EstimatorSpec:
    """Import a package's specification; what is opened by it fails in one line, too."""
    with _named_in_errors(point):
        spec = point.load()
    if not isinstance(spec, EstimatorSpec):
        raise _unusable(point, f"{point.value} is no EstimatorSpec but {type(spec).__name__}")
    if spec.name != point.name or spec.parameter is not None:
        raise _unusable(point, f"its EstimatorSpec is called {spec.written!r}")

    def open_guarded(opening: Opening) -> "Estimator":
        with _named_in_errors(point):
            estimator = spec.open(opening)
        if estimator.name != point.name:
            raise _unusable(point, f"what it opens is called {estimator.name!r}")
        return estimator

    package = f"{_package(point)}+src.{_source_digest(point)}"
    return replace(spec, open=open_guarded, calibration=None, package=package)


@contextmanager
def _named_in_errors(point: "EntryPoint") -> Iterator[None]:
    """Name the package in whatever its code raises: nobody here can know what that may be.

    Raises:
        PluginError: the package's code failed, other than by an error of this program.
    """
    try:
        yield
    except UasthnError:
        raise
    except Exception as error:  # of code that is not ours; without this, we would seem at fault
        raise _unusable(point, f"{type(error).__name__}: {error}") from error


def _unusable(point: "EntryPoint", why: str) -> PluginError:
    return PluginError(f"--estimator {point.name} of {_package(point)} cannot be used: {why}")


def _package(point: "EntryPoint") -> str:
    """Return the name and version of the package that an entry point belongs to."""
    dist = point.dist
    return f"module {point.module}" if dist is None else f"{dist.name} {dist.version}"


def _source_digest(point: "EntryPoint") -> str:
    """Return the hash of the package's source: resuming must tell two states of it apart."""
    for name in (point.module.partition(".")[0], point.module):
        file = sys.modules[name].__file__
        if file is not None:  # a namespace has none
            path = Path(file)
            whole = path.parent if path.name == "__init__.py" else path
            return source_sha256(whole)[:HASH_DIGITS]
    return "unknown"


def _points() -> tuple["EntryPoint", ...]:
    return _points_on(tuple(sys.path))


@lru_cache
def _points_on(_: tuple[str, ...]) -> tuple["EntryPoint", ...]:
    """Return the entry points on a search path: reading all packages' takes some milliseconds."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - `uasthn --help` does without it

    return tuple(entry_points(group=GROUP))
