"""The matchers of the ``vismatch`` package (an extra) as estimators named ``vismatch:NAME``.

Written against vismatch 1.4; before version 1.1 the package was called image-matching-models.
"""

import logging
import pickle
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from difflib import get_close_matches
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.torch import load_file

from uasthn_cli.errors import MissingExtraError, WeightsError
from uasthn_cli.geometry.corners import DegenerateHomographyError
from uasthn_cli.matching.device import choose_device
from uasthn_cli.matching.keypoint_matches import Matches, estimate_from_matches
from uasthn_cli.seam import Estimate
from uasthn_cli.types import FloatArray, ImageArray, MapFeatures, MapWindow, Ortho

_log = logging.getLogger(__name__)

PREFIX = "vismatch:"

_CHECKPOINT_ARGUMENT = {"upal": "weights_path"}
"""Matchers that read a checkpoint of the user's choice, and the argument that takes its path."""

_STRETCH_PERCENT = (1.0, 99.0)

_MATCHER_ERRORS = (cv2.error, RuntimeError, ValueError, IndexError)
"""What matchers raise on a pair in which they find nothing: each in its own way."""


class VismatchEstimator:
    """Matches the ortho with the whole map window, both in colour, and fits homographies.

    Confidence is the belief of :func:`uasthn_cli.matching.keypoint_matches.match_belief`: how many
    of the frame's matches agree on its homography, and how many do not.
    """

    stride_px = 1
    halo_px = 0

    def __init__(self, name: str, matcher: Any) -> None:
        """Use a ``vismatch.BaseMatcher``, known to ``--estimator`` by ``name``."""
        self.name, self._matcher = name, matcher

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return colour ``(3, h, w)`` in 0..1: a matcher wants the whole window, not tiles."""
        return np.moveaxis(window.image, -1, 0)

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return each view's corners by its own homography from ortho to window.

        Raises:
            DegenerateHomographyError: the full frame's matches give no homography.
        """
        frame = np.repeat(_stretched(thermal)[None], 3, axis=0)
        matches = self._matches(frame, features.values.astype(np.float32))
        return estimate_from_matches(features, thermal, views_px, origin_px, matches)

    def _matches(self, frame: ImageArray, window: ImageArray) -> Matches:
        """Return matched places in two images ``(3, h, w)``.

        Raises:
            DegenerateHomographyError: the matcher fails on them.
        """
        try:
            with _prints_logged():
                result = self._matcher(frame, window)
        except _MATCHER_ERRORS as error:
            reason = " ".join(str(error).split())
            raise DegenerateHomographyError(f"{self.name} failed: {reason}") from error
        here, there = (
            np.asarray(result[key], np.float64).reshape(-1, 2)
            for key in ("matched_kpts0", "matched_kpts1")
        )
        return here, there


def open_vismatch(name: str, weights_path: Path | None, device: str) -> VismatchEstimator:
    """Return the estimator ``vismatch:NAME`` on ``auto|cpu|cuda``.

    ``weights_path`` is handed on to a matcher that takes a checkpoint's path; any other gets it as
    a safetensors file of its whole ``state_dict()``, laid over the weights that vismatch fetches.

    Raises:
        MissingExtraError: vismatch, or what it needs for this matcher, is not installed.
        WeightsError: weights cannot be fetched, read or used.
    """
    matcher_name = name.removeprefix(PREFIX)
    arguments: dict[str, Any] = {}
    if weights_path is not None:
        if not weights_path.is_file():
            raise WeightsError(f"{weights_path}: no such weights file")
        if matcher_name in _CHECKPOINT_ARGUMENT:
            arguments[_CHECKPOINT_ARGUMENT[matcher_name]] = weights_path
    matcher = _matcher(_package(matcher_name), matcher_name, choose_device(device), arguments)
    if weights_path is not None and not arguments:
        _load_weights(matcher, name, weights_path)
    return VismatchEstimator(name, matcher)


def _package(matcher_name: str) -> Any:
    """Return the package, which must have the matcher."""
    try:
        package = import_module("vismatch")
    except ImportError as error:
        raise MissingExtraError(
            f"--estimator {PREFIX}{matcher_name} needs a package that is not installed"
            f" ({error}): pip install 'uasthn[vismatch]'"
        ) from error
    if matcher_name not in package.available_models:
        close = get_close_matches(matcher_name, package.available_models) or sorted(
            package.available_models
        )
        raise MissingExtraError(
            f"the vismatch installed has no matcher {matcher_name!r}; it has, say,"
            f" {', '.join(close[:5])}"
        )
    return package


def _matcher(package: Any, matcher_name: str, device: str, arguments: dict[str, Any]) -> Any:
    """Return a matcher with its weights."""
    try:
        with _prints_logged():
            return package.get_matcher(matcher_name, device=device, **arguments)
    except ImportError as error:
        raise MissingExtraError(
            f"vismatch's {matcher_name} needs a package that is not installed: {error}"
        ) from error
    except (OSError, RuntimeError, ValueError, KeyError, pickle.UnpicklingError) as error:
        reason = " ".join(str(error).split())
        raise WeightsError(
            f"weights of {PREFIX}{matcher_name} cannot be loaded ({reason}); vismatch fetches them"
            " from the Hugging Face hub once and keeps them"
        ) from error


@contextmanager
def _prints_logged() -> Iterator[None]:
    """Log what is printed meanwhile: standard output is not vismatch's to write on."""
    with redirect_stdout(StringIO()) as printed:
        try:
            yield
        finally:
            for line in filter(str.strip, printed.getvalue().splitlines()):
                _log.info("vismatch: %s", line.strip())


def _load_weights(matcher: Any, name: str, path: Path) -> None:
    """Replace all weights of a matcher."""
    if not matcher.state_dict():
        raise WeightsError(f"{name} has no weights that could be replaced; leave out --weights")
    try:
        matcher.load_state_dict(load_file(path))
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path}: not a readable safetensors file ({error})") from error
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise WeightsError(f"{path}: these weights are not for {name} ({reason})") from error


def _stretched(thermal: Ortho) -> ImageArray:
    """Return the ortho's grey values ``(h, w)`` in 0..1, 0 where not valid."""
    if not thermal.valid.any():
        return np.zeros(thermal.valid.shape, np.float32)
    low, high = np.percentile(thermal.image[thermal.valid], _STRETCH_PERCENT)
    grey = np.clip((thermal.image - low) / max(float(high - low), 1e-6), 0.0, 1.0)
    return np.where(thermal.valid, grey, 0.0).astype(np.float32)
