"""Pictures of what a run's stated uncertainties are worth."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.report.drawing import (
    BLUE,
    GREEN,
    HEIGHT_IN,
    ORANGE,
    REFERENCE,
    WIDTH_IN,
    Axes,
    Figure,
    FuncFormatter,
    PercentFormatter,
    encode,
    legend_below,
    legend_beside,
    new_figure,
    styled,
    title,
)
from uasthn_cli.report.load import RunResults
from uasthn_cli.report.metrics import column
from uasthn_cli.report.trust import (
    expected_calibration_error,
    radius_coverage,
    risk_coverage,
    roc_curve,
)
from uasthn_cli.report.trust_summary import JudgedAnswers, judged_answers, risk_reliability
from uasthn_cli.types import BoolArray, FloatArray

NEEDS: Final[Mapping[str, str]] = {
    "risk-coverage": "an uncertainty of an answer whose error is known",
    "roc": "uncertainties of answers whose error is known, within the tolerance and beyond",
    "reliability": "the risk of an answer whose error is known",
    "errors": "an answer whose error is known",
}
"""The figures of a run by name, and what each of them cannot do without."""

_SIGNAL_STYLES: Final[Mapping[str, Mapping[str, Any]]] = {
    "risk": {"color": BLUE, "linestyle": "-", "linewidth": 2.6},
    "confidence": {"color": ORANGE, "linestyle": (0, (6, 2))},
    "entropy": {"color": GREEN, "linestyle": (0, (6, 2, 1.2, 2))},
    "sigma_m": {"color": "#CC79A7", "linestyle": (0, (1.2, 1.2))},
    "u_m": {"color": "#E69F00", "linestyle": (0, (3, 1.5))},
    "agreement_m": {"color": "#56B4E9", "linestyle": (0, (6, 2, 1.2, 2, 1.2, 2))},
    "support": {"color": "#F0E442", "linestyle": (0, (6, 1.5))},
}
_LEAST_SHOWN_M: Final = 0.1
_RATIO_SHOWN: Final = 3.0


def draw_run(
    run: RunResults, tolerance_m: float = TOLERANCE_M, file_format: str = "png"
) -> dict[str, bytes | None]:
    """Draw a run's figures: the bytes of a ``png`` or ``svg`` file per name in ``NEEDS``.

    The same run gives the same bytes on the same machine. A figure is None where the run lacks
    what it needs.
    """
    answers = judged_answers(run, tolerance_m)
    with styled():
        figures = {
            "risk-coverage": _risk_coverage_figure(answers, run.name, tolerance_m),
            "roc": _roc_figure(answers, run.name, tolerance_m),
            "reliability": _reliability_figure(answers, run.name),
            "errors": _errors_figure(answers, run, tolerance_m),
        }
        return {name: encode(figure, file_format) for name, figure in figures.items()}


def _risk_coverage_figure(answers: JudgedAnswers, name: str, tolerance_m: float) -> Figure | None:
    """Draw the risk–coverage curve of every signal, the ideal order and what was accepted."""
    figure, axes = new_figure()
    title(figure, "Risk–coverage", name)
    for signal, known in _known_uncertainties(answers).items():
        curve = risk_coverage(answers.uncertainties[signal][known], answers.wrong[known])
        if curve is not None:
            label = f"{signal}: area {curve.aurc:.3f}{_of(known)}"
            axes.plot(curve.coverage, curve.risk, label=label, **_SIGNAL_STYLES[signal])
    blind = risk_coverage(np.zeros(answers.wrong.size), answers.wrong)
    if not axes.lines or blind is None:
        return None
    ideal = f"ideal order: area {blind.ideal_aurc:.3f}"
    axes.plot(blind.coverage, blind.ideal_risk, label=ideal, linestyle=":", **REFERENCE)
    everything = f"no order: area {blind.aurc:.3f}"
    axes.axhline(blind.aurc, label=everything, linestyle="-", **REFERENCE)
    if answers.accepted.any():
        point = answers.accepted.mean(), answers.wrong[answers.accepted].mean()
        label = f"accepted: {point[1]:.3f} at {point[0]:.2f}"
        axes.plot(*point, "kD", markersize=8, label=label, clip_on=False, zorder=5)
    axes.set_xlabel(f"coverage: share of the {answers.wrong.size} answers, most trusted first")
    axes.set_ylabel(f"risk: share of them beyond {tolerance_m:g} m")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(bottom=0.0)
    legend_below(figure, axes)
    return figure


def _roc_figure(answers: JudgedAnswers, name: str, tolerance_m: float) -> Figure | None:
    """Draw the receiver operating characteristic of every signal."""
    figure, axes = new_figure()
    title(figure, "ROC", name)
    for signal, known in _known_uncertainties(answers).items():
        roc = roc_curve(answers.uncertainties[signal][known], answers.wrong[known])
        if roc is not None:
            label = f"{signal}: AUC {roc.auc:.3f}{_of(known)}"
            rates = roc.false_positive_rate, roc.true_positive_rate
            axes.plot(*rates, label=label, clip_on=False, **_SIGNAL_STYLES[signal])
    if not axes.lines:
        return None
    axes.plot([0, 1], [0, 1], label="chance: AUC 0.500", linestyle="-", **REFERENCE)
    wrong = int(answers.wrong.sum())
    good = answers.wrong.size - wrong
    axes.set_xlabel(f"share of {good} good answers (within {tolerance_m:g} m) flagged")
    axes.set_ylabel(f"share of {wrong} wrong answers flagged")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_aspect("equal")
    legend_beside(figure, axes)
    return figure


def _reliability_figure(answers: JudgedAnswers, name: str) -> Figure | None:
    """Draw predicted against observed risk, and how the predictions are spread."""
    bins = risk_reliability(answers)
    if not bins:
        return None
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN + 0.6), layout="constrained")
    axes, spread = figure.subplots(2, 1, sharex=True, height_ratios=[4, 1])
    title(figure, "Reliability of the predicted risk", name)
    predicted = np.array([one.predicted for one in bins])
    observed = np.array([one.observed for one in bins])
    low_high = np.array([[one.observed_low, one.observed_high] for one in bins]).T
    axes.plot([0, 1], [0, 1], label="perfectly calibrated", linestyle="--", **REFERENCE)
    axes.errorbar(
        predicted,
        observed,
        yerr=np.abs(low_high - observed),
        label="bins of equal count, 95 % interval",
        **{"color": BLUE, "marker": "o", "markersize": 7, "capsize": 4, "clip_on": False},
    )
    error = expected_calibration_error(bins)
    axes.plot([], [], " ", label=f"expected calibration error {error:.3f}")
    axes.set_ylabel(f"observed share beyond {TOLERANCE_M:g} m")
    axes.set_ylim(0.0, 1.0)
    axes.legend(loc="upper left")
    spread.hist(answers.risk[np.isfinite(answers.risk)], np.linspace(0.0, 1.0, 41), color=BLUE)
    spread.set_xlim(0.0, 1.0)
    spread.set_xlabel(f"predicted risk: probability of an error beyond {TOLERANCE_M:g} m")
    spread.set_ylabel("answers")
    return figure


def _errors_figure(answers: JudgedAnswers, run: RunResults, tolerance_m: float) -> Figure | None:
    """Draw how the centre errors are distributed, in metres and against the predicted CE90."""
    if not answers.ce_m.size:
        return None
    has_radius = np.isfinite(answers.ce90_m)
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
    panels = figure.subplots(1, 1 + int(has_radius.any()), squeeze=False)[0]
    title(figure, "Centre errors", run.name)
    _draw_errors(panels[0], answers, column(run.rows, "prior_ce_m"), tolerance_m)
    if has_radius.any():
        _draw_ratios(panels[1], answers, has_radius)
    for axes in panels:
        axes.set_ylim(0.0, 1.0)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17))
    panels[0].set_ylabel("share of answers with at most this error")
    return figure


def _draw_errors(
    axes: Axes, answers: JudgedAnswers, prior_ce_m: FloatArray, tolerance_m: float
) -> None:
    """Draw the distribution of CE, of accepted answers and of the prior's error."""
    accepted_m = answers.ce_m[answers.accepted]
    prior_m = prior_ce_m[np.isfinite(prior_ce_m)]
    for errors_m, label, style in (
        (answers.ce_m, "all", {"color": BLUE}),
        (accepted_m, "accepted", {"color": ORANGE, "linestyle": (0, (6, 2))}),
        (prior_m, "logged position", {"color": "#555555", "linestyle": (0, (1.2, 1.2))}),
    ):
        if errors_m.size:
            legend = f"{label}: {errors_m.size}, median {np.median(errors_m):.1f} m"
            axes.ecdf(np.maximum(errors_m, _LEAST_SHOWN_M), label=legend, **style)
    axes.axvline(tolerance_m, label=f"tolerance {tolerance_m:g} m", linestyle="-", **REFERENCE)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlabel("centre error CE [m]")


def _draw_ratios(axes: Axes, answers: JudgedAnswers, has_radius: BoolArray) -> None:
    """Draw the distribution of CE over its predicted CE90: nine tenths should be below 1."""
    for chosen, label, style in (
        (has_radius, "all", {"color": BLUE}),
        (
            has_radius & answers.accepted,
            "accepted",
            {"color": ORANGE, "linestyle": (0, (6, 2))},
        ),
    ):
        ce_m, ce90_m = answers.ce_m[chosen], answers.ce90_m[chosen]
        share = radius_coverage(ce_m, ce90_m)
        if share is not None:
            ratio = ce_m / np.maximum(ce90_m, np.finfo(np.float64).tiny)
            ratio = np.minimum(ratio, 2.0 * _RATIO_SHOWN)
            axes.ecdf(ratio, label=f"{label}: {share:.1%} within CE90", **style)
    ratio = np.linspace(0.0, _RATIO_SHOWN, 200)
    normal = "circular normal errors: 90 %"
    axes.plot(ratio, 1.0 - 0.1 ** (ratio**2), label=normal, linestyle=":", **REFERENCE)
    axes.axvline(1.0, linestyle="-", **REFERENCE)
    axes.axhline(0.9, linestyle="-", **REFERENCE)
    axes.set_xlim(0.0, _RATIO_SHOWN)
    axes.set_xlabel("CE / predicted CE90")


def _known_uncertainties(answers: JudgedAnswers) -> dict[str, BoolArray]:
    """Return which answers have each signal ``(n,)``, for signals that any answer has."""
    known = {name: np.isfinite(uncertainty) for name, uncertainty in answers.uncertainties.items()}
    return {name: flags for name, flags in known.items() if flags.any()}


def _of(chosen: BoolArray) -> str:
    """Say of how many answers a curve is, unless it is of all."""
    return "" if chosen.all() else f" (of {chosen.sum()})"
