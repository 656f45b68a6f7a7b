"""What a run's stated uncertainties are worth against truth."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.report.intervals import Interval, share_intervals
from uasthn_cli.report.load import RunResults
from uasthn_cli.report.metrics import column, share_of
from uasthn_cli.report.trust import (
    ReliabilityBin,
    expected_calibration_error,
    radius_coverage,
    reliability_bins,
    risk_coverage,
    roc_curve,
    within_radius,
)
from uasthn_cli.types import BoolArray, FloatArray

SIGNALS: Final[Mapping[str, float]] = {
    "risk": 1.0,
    "confidence": -1.0,
    "entropy": 1.0,
    "sigma_m": 1.0,
    "u_m": 1.0,
    "agreement_m": 1.0,
    "support": -1.0,
}
"""Columns that say how far to trust an answer, and their sign as uncertainties."""

LEVELS: Final = (0.5, 0.8, 0.9, 0.95)


@dataclass(frozen=True, slots=True)
class JudgedAnswers:
    """Answers with a known error: CE, whether accepted and beyond the tolerance, all ``(n,)``.

    ``risk`` and ``ce90_m`` are what was predicted, NaN where nothing was, ``camera_ce_m`` and
    ``camera_ce90_m`` the camera's error and what was predicted of it. ``uncertainties`` holds per
    signal one number that is larger the less the signal trusts an answer, likewise.
    """

    ce_m: FloatArray
    accepted: BoolArray
    wrong: BoolArray
    risk: FloatArray
    ce90_m: FloatArray
    camera_ce_m: FloatArray
    camera_ce90_m: FloatArray
    uncertainties: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class SignalWorth:
    """How well one signal sorts wrong answers from good ones, over the answers that have it.

    ``auc`` is the area under the ROC, ``aurc`` the area under the risk–coverage curve,
    ``excess_aurc`` how far that is above the ideal order; None where it is not defined.
    """

    answers: int
    auc: float | None
    aurc: float | None
    excess_aurc: float | None


@dataclass(frozen=True, slots=True)
class TrustSummary:
    """Stated uncertainties against truth; what has nothing to stand on is None.

    Judged are answers with a known error. ``accepted_risk`` is the share of accepted ones beyond
    the tolerance, ``ideal_aurc`` the area under the risk–coverage curve of an order that knows
    the truth. Reliability and ``expected_calibration_error`` are of the column ``risk``, always
    at the 25 m that it predicts. ``ce90_coverage`` is the share of errors within the predicted
    CE90, ``camera_ce90_coverage`` that of the camera's; ``coverage_at_levels`` assumes circular
    normal errors, except at 0.9. ``intervals`` holds the 95 % interval of each share.
    """

    judged: int
    beyond_tolerance: int
    accepted_risk: float | None
    signals: Mapping[str, SignalWorth]
    ideal_aurc: float | None
    ce90_coverage_all: float | None
    ce90_coverage_accepted: float | None
    camera_ce90_coverage_all: float | None
    camera_ce90_coverage_accepted: float | None
    coverage_at_levels: Mapping[str, float | None]
    expected_calibration_error: float | None
    reliability: tuple[ReliabilityBin, ...]
    intervals: Mapping[str, Interval]


def judged_answers(run: RunResults, tolerance_m: float) -> JudgedAnswers:
    """Return the run's answers whose error is known; wrong is a CE beyond the tolerance."""
    rows = [row for row in run.rows if row.has_estimate and np.isfinite(row.ce_m)]
    ce_m = column(rows, "ce_m")
    return JudgedAnswers(
        ce_m=ce_m,
        accepted=np.array([row.accepted for row in rows], dtype=np.bool_),
        wrong=ce_m > tolerance_m,
        risk=column(rows, "risk"),
        ce90_m=column(rows, "ce90_m"),
        camera_ce_m=column(rows, "camera_ce_m"),
        camera_ce90_m=column(rows, "camera_ce90_m"),
        uncertainties={name: sign * column(rows, name) for name, sign in SIGNALS.items()},
    )


def summarise_trust(run: RunResults, tolerance_m: float = TOLERANCE_M) -> TrustSummary | None:
    """Judge what a run says of its own errors; None for a run without truth."""
    if not run.has_truth:
        return None
    answers = judged_answers(run, tolerance_m)
    accepted = answers.accepted
    ideal = risk_coverage(np.zeros(answers.wrong.size), answers.wrong)
    bins = risk_reliability(answers)
    covered = _coverage_flags(answers)
    return TrustSummary(
        judged=accepted.size,
        beyond_tolerance=int(answers.wrong.sum()),
        accepted_risk=share_of(answers.wrong[accepted]),
        signals={
            name: _worth(uncertainty, answers.wrong)
            for name, uncertainty in answers.uncertainties.items()
        },
        ideal_aurc=ideal.ideal_aurc if ideal else None,
        ce90_coverage_all=share_of(covered["ce90_coverage_all"]),
        ce90_coverage_accepted=share_of(covered["ce90_coverage_accepted"]),
        camera_ce90_coverage_all=share_of(covered["camera_ce90_coverage_all"]),
        camera_ce90_coverage_accepted=share_of(covered["camera_ce90_coverage_accepted"]),
        coverage_at_levels={
            f"{level:g}": radius_coverage(answers.ce_m, answers.ce90_m, level) for level in LEVELS
        },
        expected_calibration_error=expected_calibration_error(bins),
        reliability=bins,
        intervals=share_intervals(accepted_risk=answers.wrong[accepted], **covered),
    )


def _coverage_flags(answers: JudgedAnswers) -> dict[str, BoolArray]:
    """Return which errors lie within their stated radius, by the name of the coverage."""
    centre, camera = (answers.ce_m, answers.ce90_m), (answers.camera_ce_m, answers.camera_ce90_m)
    flags = {}
    for name, (ce_m, ce90_m) in {"ce90": centre, "camera_ce90": camera}.items():
        flags[f"{name}_coverage_all"] = within_radius(ce_m, ce90_m)
        accepted = answers.accepted
        flags[f"{name}_coverage_accepted"] = within_radius(ce_m[accepted], ce90_m[accepted])
    return flags


def risk_reliability(answers: JudgedAnswers) -> tuple[ReliabilityBin, ...]:
    """Return the bins of the column ``risk``, judged at the 25 m that it speaks of."""
    has_risk = np.isfinite(answers.risk)
    beyond = answers.ce_m > TOLERANCE_M
    return reliability_bins(answers.risk[has_risk], beyond[has_risk])


def _worth(uncertainty: FloatArray, wrong: BoolArray) -> SignalWorth:
    """Judge one signal on the answers that have it."""
    known = np.isfinite(uncertainty)
    roc, curve = (
        roc_curve(uncertainty[known], wrong[known]),
        risk_coverage(uncertainty[known], wrong[known]),
    )
    return SignalWorth(
        answers=int(known.sum()),
        auc=roc.auc if roc else None,
        aurc=curve.aurc if curve else None,
        excess_aurc=curve.aurc - curve.ideal_aurc if curve else None,
    )
