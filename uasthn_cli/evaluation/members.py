"""Open the networks that answer: a base network, and further members of a deep ensemble."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from uasthn_cli.matching.registry import bundled_ensemble, open_estimator
from uasthn_cli.seam import Estimator


def open_members(
    name: str,
    weights: Sequence[Path],
    *,
    device: str,
    symmetries: int,
    ensemble: bool,
    ue_iterations: int | None = None,
) -> list[Estimator]:
    """Return an estimator for each file of weights, the first being the base network.

    Without any it is the estimator as it comes; ``ensemble`` takes the members in the box;
    ``ue_iterations`` is the paper's early stopping.

    Raises:
        WeightsError: the weights cannot be used, or there is no ensemble in the box.
        MissingExtraError: the estimator needs an optional package that is not installed.
    """
    paths: Sequence[Path | None] = [*weights] or [None]
    if ensemble:
        paths = bundled_ensemble(name, weights)
    return [
        open_estimator(
            name,
            weights=() if path is None else (path,),
            device=device,
            symmetries=symmetries,
            ue_iterations=ue_iterations,
        )
        for path in paths
    ]


def describe_weights(weights: Sequence[Path], *, ensemble: bool) -> tuple[str, ...]:
    """Return the files' names with the beginning of their SHA-256, for the predictions' header."""
    if ensemble:
        return ("ensemble in the box",)
    return tuple(describe_file(path) for path in weights)


def describe_file(path: Path) -> str:
    """Return a file's name with the beginning of its SHA-256."""
    return f"{path.name}@{hashlib.sha256(path.read_bytes()).hexdigest()[:12]}"
