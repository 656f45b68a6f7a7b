"""Judged answers in numbers: the paper's measures, and whether uncertainty tells good from bad."""

from dataclasses import dataclass

import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.evaluation.judging import Judged
from uasthn_cli.report.trust import Roc, risk_coverage, roc_curve
from uasthn_cli.types import FloatArray


@dataclass(frozen=True, slots=True)
class Scores:
    """One method on one set of samples; None where there is nothing to stand on.

    ``mace_m`` and ``ce_m`` are means over accepted samples, ``*_all_m`` over all;
    ``accepted_fraction`` is the paper's success rate, ``accepted_within`` the share of accepted
    samples with a CE within the tolerance. ``auc`` is the area under the ROC for a MACE beyond the
    tolerance, ``aurc`` that under the risk-coverage curve for the same.
    """

    samples: int
    answered: int
    mace_m: float | None
    ce_m: float | None
    accepted_fraction: float
    accepted_within: float | None
    mace_all_m: float
    ce_all_m: float
    within_all: float
    auc: float | None
    aurc: float | None


@dataclass(frozen=True, slots=True)
class AcceptanceCurve:
    """Accepted fraction and mean MACE of the accepted ``(k,)`` as the threshold grows."""

    threshold_m: FloatArray
    accepted_fraction: FloatArray
    mace_m: FloatArray


def score(judged: Judged, tolerance_m: float = TOLERANCE_M) -> Scores:
    """Return the figures of one method."""
    accepted = judged.accepted
    within = judged.ce_m <= tolerance_m
    roc = roc_of(judged, tolerance_m)
    curve = risk_coverage(judged.uncertainty_m, judged.mace_m > tolerance_m)
    return Scores(
        samples=len(accepted),
        answered=int(judged.answered.sum()),
        mace_m=_mean(judged.mace_m[accepted]),
        ce_m=_mean(judged.ce_m[accepted]),
        accepted_fraction=float(accepted.mean()),
        accepted_within=_mean(within[accepted]),
        mace_all_m=float(judged.mace_m.mean()),
        ce_all_m=float(judged.ce_m.mean()),
        within_all=float(within.mean()),
        auc=None if roc is None else roc.auc,
        aurc=None if curve is None or not has_uncertainty(judged) else curve.aurc,
    )


def roc_of(judged: Judged, tolerance_m: float = TOLERANCE_M) -> Roc | None:
    """Return the ROC of the uncertainty for a MACE beyond the tolerance (paper, Fig. 4).

    None without uncertainties, or unless there are good and wrong answers.
    """
    if not has_uncertainty(judged):
        return None
    return roc_curve(judged.uncertainty_m, judged.mace_m > tolerance_m)


def has_uncertainty(judged: Judged) -> bool:
    """Tell whether the method says anything of its answers."""
    known = judged.uncertainty_m[judged.answered]
    return bool(known.size and np.ptp(known) > 0.0)


def acceptance_curve(judged: Judged) -> AcceptanceCurve:
    """Return what each threshold would accept (the form of the paper's ablations, Fig. 3).

    One point per distinct uncertainty; samples without an answer are never accepted.
    """
    order = np.argsort(judged.uncertainty_m, kind="stable")
    threshold_m = judged.uncertainty_m[order]
    taken = np.arange(1, len(order) + 1)
    mace_m = np.cumsum(judged.mace_m[order]) / taken
    is_last = np.append(threshold_m[1:] > threshold_m[:-1], True) & np.isfinite(threshold_m)
    return AcceptanceCurve(threshold_m[is_last], (taken / len(order))[is_last], mace_m[is_last])


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None
