"""A package with the interface of vismatch 1.4, and matchers that need no download."""

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray


class GridMatcher(torch.nn.Module):
    """Finds the first image in the second by correlation, and says so at a grid of points."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__()
        self.arguments = arguments
        self.seen: list[NDArray[np.float32]] = []

    def forward(
        self, first: NDArray[np.float32], second: NDArray[np.float32]
    ) -> dict[str, NDArray[np.float32]]:
        sys.stdout.write("a matcher that talks\n")
        self.seen = [first, second]
        scores = cv2.matchTemplate(second[0], first[0], cv2.TM_CCOEFF_NORMED)
        shift = np.array(np.unravel_index(np.argmax(np.abs(scores)), scores.shape)[::-1])
        height, width = first.shape[-2:]
        grid = np.mgrid[4 : width - 4 : 6, 4 : height - 4 : 6].reshape(2, -1).T
        here = grid.astype(np.float32)
        return {"matched_kpts0": here, "matched_kpts1": (here + shift).astype(np.float32)}


class WeightedMatcher(GridMatcher):
    """Has weights of its own."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.model = torch.nn.Linear(2, 1)


class BlindMatcher(GridMatcher):
    """Fails where there is nothing to see, as matchers do."""

    def forward(self, *_: Any) -> dict[str, NDArray[np.float32]]:
        raise ValueError("not enough values to unpack\n(expected 2, got 1)")


class UpalMatcher(GridMatcher):
    """Takes the path of a checkpoint."""

    def __init__(self, *, weights_path: Path | None = None, **arguments: Any) -> None:
        super().__init__(weights_path=weights_path, **arguments)


MATCHERS = {
    "grid": GridMatcher,
    "weighted": WeightedMatcher,
    "blind": BlindMatcher,
    "upal": UpalMatcher,
}


def get_matcher(matcher_name: str, device: str = "cpu", **arguments: Any) -> Any:
    sys.stdout.write("no connection to the hub\n")
    if matcher_name == "unfetched":
        raise FileNotFoundError("no snapshot\non the local disk")
    if matcher_name == "needy":
        raise ModuleNotFoundError("No module named 'tensorflow'")
    return MATCHERS[matcher_name](device=device, **arguments)


def pretend_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the fake where the package would be."""
    package = ModuleType("vismatch")
    vars(package).update(
        available_models=[*MATCHERS, "unfetched", "needy"], get_matcher=get_matcher
    )
    monkeypatch.setitem(sys.modules, "vismatch", package)
