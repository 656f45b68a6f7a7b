"""The paper's figures, drawn from predictions alone: ROC, histogram, accepted fraction and MACE."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from uasthn_cli.evaluation.judging import Judged
from uasthn_cli.evaluation.metrics import acceptance_curve, has_uncertainty, roc_of
from uasthn_cli.report.drawing import (
    REFERENCE,
    Axes,
    Figure,
    PercentFormatter,
    encode,
    legend_below,
    new_figure,
    styled,
)

FIGURES: Final = ("roc", "mace-histogram", "accepted-mace")
"""Names of the figures."""

_STYLES: Final[tuple[dict[str, Any], ...]] = (
    {"color": "#0072B2", "linestyle": "-"},
    {"color": "#D55E00", "linestyle": (0, (6, 2))},
    {"color": "#009E73", "linestyle": (0, (6, 2, 1.2, 2))},
    {"color": "#CC79A7", "linestyle": (0, (1.2, 1.2))},
    {"color": "#E69F00", "linestyle": (0, (3, 1.5))},
    {"color": "#56B4E9", "linestyle": (0, (6, 2, 1.2, 2, 1.2, 2))},
    {"color": "#000000", "linestyle": (0, (8, 3))},
)
_BINS: Final = (5, 40)
"""Fewest and most bins of the histogram."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One method on one run."""

    run: str
    method: str
    judged: Judged

    @property
    def label(self) -> str:
        """The name in the legend."""
        return f"{self.run}, {self.method}"


def draw_evaluation(
    curves: Sequence[Curve], tolerance_m: float, file_format: str
) -> dict[str, bytes | None]:
    """Return the bytes of a ``png`` or ``svg`` file per name in ``FIGURES``.

    None where there is nothing to draw. The same curves give the same bytes on the same machine.
    """
    with styled():
        figures = {
            "roc": _roc_figure(curves, tolerance_m),
            "mace-histogram": _histogram_figure(_distinct(curves), tolerance_m),
            "accepted-mace": _acceptance_figure(curves),
        }
        return {name: encode(figure, file_format) for name, figure in figures.items()}


def _roc_figure(curves: Sequence[Curve], tolerance_m: float) -> Figure | None:
    """Draw how many wrong answers are rejected at the price of how many good ones (Fig. 4)."""
    figure, axes = new_figure()
    for curve, style in _styled(curves):
        roc = roc_of(curve.judged, tolerance_m)
        if roc is not None:
            label = f"{curve.label}: AUC {roc.auc:.3f}"
            axes.plot(roc.false_positive_rate, roc.true_positive_rate, label=label, **style)
    if not axes.lines:
        return None
    axes.plot([0, 1], [0, 1], label="chance: AUC 0.500", linestyle="-", **REFERENCE)
    axes.set_xlabel(f"share of answers with MACE ≤ {tolerance_m:g} m rejected")
    axes.set_ylabel(f"share with MACE > {tolerance_m:g} m rejected")
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), aspect="equal")
    legend_below(figure, axes, 1)
    return figure


def _histogram_figure(curves: Sequence[Curve], tolerance_m: float) -> Figure:
    """Draw how errors are distributed (Fig. 5)."""
    figure, axes = new_figure()
    largest_m = max(float(curve.judged.mace_m.max()) for curve in curves)
    smallest_m = min(float(curve.judged.mace_m.min()) for curve in curves)
    fewest = min(curve.judged.mace_m.size for curve in curves)
    bins = int(np.clip(2.0 * np.sqrt(fewest), *_BINS))
    edges_m = np.geomspace(max(smallest_m, 0.1), max(largest_m, 1.0) * 1.001, bins + 1)
    runs = [curve.run for curve in curves]
    for curve, style in _styled(curves):
        mace_m = np.maximum(curve.judged.mace_m, edges_m[0])
        share = np.histogram(mace_m, edges_m)[0] / mace_m.size
        name = curve.run if runs.count(curve.run) == 1 else curve.label
        label = f"{name}: median {np.median(mace_m):.1f} m"
        axes.stairs(share, edges_m, label=label, linewidth=2.0, **style)
    axes.axvline(tolerance_m, label=f"{tolerance_m:g} m", linestyle="-", **REFERENCE)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.set_xlabel("MACE [m]")
    axes.set_ylabel("share of samples")
    axes.set_ylim(bottom=0.0)
    legend_below(figure, axes, 1)
    return figure


def _acceptance_figure(curves: Sequence[Curve]) -> Figure:
    """Draw accepted fraction against the MACE of what is accepted, over thresholds (Fig. 3)."""
    figure, axes = new_figure()
    for curve, style in _styled(curves):
        judged = curve.judged
        if has_uncertainty(judged):
            points = acceptance_curve(judged)
            axes.plot(points.mace_m, points.accepted_fraction, label=curve.label, **style)
            _mark(axes, judged, style)
        else:
            color = style["color"]
            mean_m = float(judged.mace_m.mean())
            axes.plot(mean_m, 1.0, "D", color=color, label=curve.label, clip_on=False)
    axes.plot([], [], "o", color="#555555", markersize=8, label="the threshold in use")
    axes.set_xlabel("mean MACE of accepted samples [m]")
    axes.set_ylabel("accepted fraction")
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 1.0)
    legend_below(figure, axes, 1)
    return figure


def _mark(axes: Axes, judged: Judged, style: dict[str, Any]) -> None:
    """Mark what the threshold in use accepts."""
    if judged.accepted.any():
        point = judged.mace_m[judged.accepted].mean(), judged.accepted.mean()
        axes.plot(*point, "o", color=style["color"], markersize=8, clip_on=False, zorder=5)


def _distinct(curves: Sequence[Curve]) -> list[Curve]:
    """Return curves without those that have the errors of one before: they only reject others."""
    kept: list[Curve] = []
    for curve in curves:
        if not any(np.array_equal(curve.judged.mace_m, one.judged.mace_m) for one in kept):
            kept.append(curve)
    return kept


def _styled(curves: Sequence[Curve]) -> list[tuple[Curve, dict[str, Any]]]:
    return [(curve, _STYLES[index % len(_STYLES)]) for index, curve in enumerate(curves)]
