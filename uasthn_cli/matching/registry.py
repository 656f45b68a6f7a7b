"""Estimators by name: those built in, each described once, and those of other packages."""

import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

from uasthn_cli.config import (
    BUNDLED_CALIBRATION,
    DEFAULT_SYMMETRIES,
    THERMAL_WIDTH_PX,
    WEIGHTS_FOLDER,
)
from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.plugins import plugin_names, plugin_spec, require_no_shadow
from uasthn_cli.matching.spec import EstimatorSpec, Opening, WeightsUse
from uasthn_cli.version import code_version

if TYPE_CHECKING:
    from uasthn_cli.seam import Estimator


def _open_xcorr(opening: Opening) -> "Estimator":
    # its libraries are heavy: a run with another estimator never loads them
    xcorr = import_module("uasthn_cli.matching.xcorr")
    in_the_box = XCORR.bundled_weights
    paths = in_the_box if opening.ensemble else (opening.weights or in_the_box[:1])
    estimator: Estimator = xcorr.open_xcorr(
        paths, opening.device, opening.symmetries, second_scale=opening.second_scale
    )
    return estimator


def _open_ncc(_: Opening) -> "Estimator":
    estimator: Estimator = import_module("uasthn_cli.matching.ncc").NccEstimator()
    return estimator


def _open_displacement(opening: Opening) -> "Estimator":
    displacement = import_module("uasthn_cli.matching.displacement.estimator")
    estimator: Estimator = displacement.open_displacement(
        opening.name, opening.weights[0], opening.device, opening.ue_iterations
    )
    return estimator


def _open_vismatch(opening: Opening) -> "Estimator":
    vismatch = import_module("uasthn_cli.matching.vismatch")
    weights = opening.weights[0] if opening.weights else None
    estimator: Estimator = vismatch.open_vismatch(opening.name, weights, opening.device)
    return estimator


def _displacement(name: str, *, has_early_stopping: bool) -> EstimatorSpec:
    """Return one of the paper's networks: they regress corners, and need weights of the user's."""
    return EstimatorSpec(
        name=name,
        open=_open_displacement,
        weights=WeightsUse.REQUIRED,
        has_early_stopping=has_early_stopping,
        may_have_head=True,
        is_trained_here=True,
    )


XCORR: Final = EstimatorSpec(
    name="xcorr",
    open=_open_xcorr,
    working_width_px=THERMAL_WIDTH_PX,
    # What a network sees at two scales is nearly independent; plain correlation only sees it again.
    # Of scales 0.5 to 2 and their sums, 0.5 helped most on rendered flights, healthy and not.
    second_scale=0.5,
    weights=WeightsUse.OPTIONAL,
    bundled_weights=tuple(
        WEIGHTS_FOLDER / f"{stem}.safetensors" for stem in ("xcorr", "xcorr-large", "xcorr-large-2")
    ),
    averages=True,
    has_symmetries=True,
    scores_shifts=True,
    is_trained_here=True,
    calibration=BUNDLED_CALIBRATION,
    works_in_processes=True,
)

NCC: Final = EstimatorSpec(
    name="ncc",
    open=_open_ncc,
    working_width_px=THERMAL_WIDTH_PX,
    scores_shifts=True,
    works_in_processes=True,
)

VISMATCH: Final = EstimatorSpec(
    name="vismatch", open=_open_vismatch, parameter="NAME", weights=WeightsUse.OPTIONAL
)

BUILT_IN: Final = {
    spec.name: spec
    for spec in (
        XCORR,
        NCC,
        _displacement("dhn", has_early_stopping=False),
        _displacement("ihn", has_early_stopping=True),
        _displacement("sthn", has_early_stopping=True),
        VISMATCH,
    )
}
"""The package's own, in the order in which they are offered."""

TRAINED_HERE: Final = tuple(spec.name for spec in BUILT_IN.values() if spec.is_trained_here)
"""What ``uasthn train --network`` makes."""


_PARAMETER: Final = re.compile(r"[\w.-]+")


def estimator_names() -> tuple[str, ...]:
    """Return the names of all estimators as a user writes them; loads none of them."""
    others = sorted(plugin_names() - set(BUILT_IN))
    return (*(spec.written for spec in BUILT_IN.values()), *others)


def spec_of(name: str) -> EstimatorSpec:
    """Return what an estimator is.

    Raises:
        ValueError: no estimator has that name.
        PluginError: another package that offers it cannot be used, or takes a built-in name.
    """
    stem, _, parameter = name.partition(":")
    spec = BUILT_IN.get(stem) or plugin_spec(name)
    if spec is not None and spec.package is None:
        require_no_shadow(stem)
        is_written_so = _PARAMETER.fullmatch(parameter) if spec.parameter else name == stem
        spec = spec if is_written_so else None
    if spec is None:
        raise ValueError(f"unknown estimator {name!r}; known: {', '.join(estimator_names())}")
    return spec


def code_of(name: str) -> str:
    """Return which code an estimator runs: this package's, and that of the one which offers it."""
    package = spec_of(name).package
    return code_version() if package is None else f"{code_version()}, {package}"


def open_estimator(
    name: str,
    *,
    weights: Sequence[Path] = (),
    device: str = "auto",
    symmetries: int = DEFAULT_SYMMETRIES,
    ensemble: bool = False,
    second_scale: bool = False,
    ue_iterations: int | None = None,
) -> "Estimator":
    """Return an estimator ready for use; the arguments are those of :class:`.spec.Opening`.

    Raises:
        WeightsError: the weights cannot be used, are missing, or the estimator takes none; an
            ensemble or early stopping that the estimator does not have.
        MissingExtraError: the estimator needs an optional package that is not installed.
        PluginError: another package that offers it cannot be used.
        ValueError: no estimator has that name.
    """
    spec = spec_of(name)
    opening = Opening(
        name, tuple(weights), device, symmetries, ensemble, second_scale, ue_iterations
    )
    _require_fit(spec, opening)
    return spec.open(opening)


def bundled_ensemble(name: str, weights: Sequence[Path] = ()) -> tuple[Path, ...]:
    """Return the networks in the box that make an ensemble; ``weights`` are those given as well.

    Raises:
        WeightsError: there is none in the box, or the user gave networks of their own.
    """
    spec = spec_of(name)
    if not spec.has_ensemble:
        raise WeightsError(f"--estimator {name} has no ensemble; leave out --ensemble")
    if weights:
        raise WeightsError("--ensemble is of the weights in the box; leave out --weights")
    return spec.bundled_weights


def has_ensemble(name: str) -> bool:
    """Tell whether an ensemble is in the box, also of an estimator that is not installed here."""
    spec = BUILT_IN.get(name)
    return spec is not None and spec.has_ensemble


def _require_fit(spec: EstimatorSpec, opening: Opening) -> None:
    """Refuse what an estimator does not understand, in one line."""
    asked, count = f"--estimator {opening.name}", len(opening.weights)
    if opening.ensemble:
        bundled_ensemble(opening.name, opening.weights)
    if count and spec.weights is WeightsUse.NONE:
        raise WeightsError(f"{asked} uses no weights; leave out --weights")
    if count > 1 and not spec.averages:
        raise WeightsError(f"{asked} is one network: open one for each file of weights")
    if opening.ue_iterations is not None and not spec.has_early_stopping:
        raise WeightsError(f"{asked} takes no steps that could be stopped early")
    if not count and spec.weights is WeightsUse.REQUIRED:
        hint = " (uasthn models pull fetches the authors', uasthn train makes some)"
        raise WeightsError(
            f"{asked} has no weights in the box: give --weights"
            f"{hint if spec.is_trained_here else ''}"
        )
