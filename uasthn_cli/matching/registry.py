"""Estimators by name."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from uasthn_cli.config import DEFAULT_SYMMETRIES
from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.seam import Estimator

DISPLACEMENT_ESTIMATORS = ("dhn", "ihn", "sthn")
"""The paper's networks: they regress corners, and need weights of the user's."""

ESTIMATORS = ("xcorr", "ncc", *DISPLACEMENT_ESTIMATORS)
"""Besides these, ``vismatch:NAME`` for the matchers of an optional package."""

AVERAGING_ESTIMATORS = ("xcorr",)
"""An ensemble of theirs is one estimator: its networks' scores are averaged into one answer."""

SECOND_SCALES = {"xcorr": 0.5}
"""Estimators that look at a second GSD as well: this times the first.

What a network sees at two scales is nearly independent; plain correlation only sees it again. Of
scales 0.5 to 2 and their sums, 0.5 helped most on rendered flights, healthy and not.
"""


def open_estimator(
    name: str,
    *,
    weights_path: Path | None = None,
    further_weights: Sequence[Path] = (),
    device: str = "auto",
    symmetries: int = DEFAULT_SYMMETRIES,
    ensemble: bool = False,
    appearance: bool = True,
    ue_iterations: int | None = None,
) -> Estimator:
    """Return an estimator ready for use; ``device`` is ``auto``, ``cpu`` or ``cuda``.

    ``xcorr`` averages the scores of the networks in ``further_weights`` with the first one's, or
    with ``ensemble`` those of all in the box; without ``appearance`` it counts nothing but learned
    features. ``ihn`` and ``sthn`` drop all views but the whole frame after ``ue_iterations`` steps
    (paper: early stopping).

    Raises:
        WeightsError: the weights cannot be used, are missing, or the estimator takes none; an
            ensemble or early stopping that the estimator does not have.
        MissingExtraError: the estimator needs an optional package that is not installed.
        ValueError: no estimator has that name.
    """
    if ensemble and name != "xcorr":
        raise WeightsError(f"--estimator {name} has no ensemble; leave out --ensemble")
    if further_weights and name not in AVERAGING_ESTIMATORS:
        raise WeightsError(f"--estimator {name} is one network: open one for each file of weights")
    if ue_iterations is not None and name not in DISPLACEMENT_ESTIMATORS:
        raise WeightsError(f"--estimator {name} takes no steps that could be stopped early")
    if name == "ncc":
        if weights_path is not None:
            raise WeightsError("--estimator ncc uses no weights; leave out --weights")
        return NccEstimator()
    # torch is heavy: a run with another estimator never loads it
    estimator: Estimator
    if name == "xcorr":
        xcorr = import_module("uasthn_cli.matching.xcorr")
        estimator = xcorr.open_xcorr(
            [path for path in (weights_path, *further_weights) if path is not None],
            device,
            symmetries,
            ensemble=ensemble,
            appearance=appearance,
        )
        return estimator
    if name in DISPLACEMENT_ESTIMATORS:
        displacement = import_module("uasthn_cli.matching.displacement.estimator")
        estimator = displacement.open_displacement(name, weights_path, device, ue_iterations)
        return estimator
    if name.startswith("vismatch:"):
        vismatch = import_module("uasthn_cli.matching.vismatch")
        estimator = vismatch.open_vismatch(name, weights_path, device)
        return estimator
    raise ValueError(f"unknown estimator {name!r}; known: {', '.join(ESTIMATORS)}, vismatch:NAME")
