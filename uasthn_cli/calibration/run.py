"""Make a calibration: fit on one part of the frames, certify on the other."""

import logging
import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from uasthn_cli.calibration.answers import Answers, RunAnswers
from uasthn_cli.calibration.fit import fit_risk_model
from uasthn_cli.config import CONFIDENCE_LEVEL, TARGET_RISK, TOLERANCE_M
from uasthn_cli.errors import CalibrationError
from uasthn_cli.types import FloatArray
from uasthn_cli.uncertainty.calibration import Calibration, Judgement, Unit
from uasthn_cli.uncertainty.conformal import (
    Refusal,
    accepted_needed,
    certify,
    conformal_scale,
    flights_needed,
    threshold_sequence,
)
from uasthn_cli.uncertainty.risk_model import RiskModel

LOGGER = logging.getLogger(__name__)

NOTHING: Final = 0.0
"""The threshold that accepts nothing: every risk is above it."""


FIT_SHARE_BY_FLIGHT: Final = 0.25
"""Of flights few are needed to fit six weights, and many to certify."""


@dataclass(frozen=True, slots=True)
class CalibrationSettings:
    """What is promised, and how frames are dealt.

    ``thin`` uses only every so many-th frame of each flight, which makes them less dependent.
    ``unit`` is what the promise is about; None: flights where there are enough to certify it
    without any error, otherwise frames.
    """

    tolerance_m: float = TOLERANCE_M
    target_risk: float = TARGET_RISK
    confidence_level: float = CONFIDENCE_LEVEL
    seed: int = 0
    thin: int = 1
    unit: Unit | None = None


def calibrate(answers: RunAnswers, settings: CalibrationSettings, note: str) -> Calibration:
    """Return the calibration of single-frame and, where there are any, fused answers.

    A kind of answer for which no threshold can be certified accepts nothing, and a warning says
    so.

    Raises:
        CalibrationError: no threshold can be certified for any kind, or there is nothing to fit.
    """
    settings = replace(settings, unit=settings.unit or default_unit(answers.single, settings))
    single, refused = judge(answers.single, settings)
    refusals = {"single": refused}
    fused = None
    if answers.fused is not None:
        fused, refusals["fused"] = judge(answers.fused, settings)
    reasons = [
        f"{kind}: {refusal_line(refusal, settings)}"
        for kind, refusal in refusals.items()
        if refusal
    ]
    if len(reasons) == len(refusals):
        raise CalibrationError("; ".join(reasons))
    for reason in reasons:
        LOGGER.warning("%s; such answers are never accepted", reason)
    return Calibration(
        tolerance_m=settings.tolerance_m,
        target_risk=settings.target_risk,
        confidence_level=settings.confidence_level,
        single=single,
        fused=fused,
        note=note,
        made_of=answers.kind,
        unit=settings.unit or Unit.FRAME,
    )


def default_unit(answers: Answers, settings: CalibrationSettings) -> Unit:
    """Return flights where there are enough of them, otherwise, with a warning, frames."""
    flights = np.unique(answers.flight).size
    needed = flights_needed(settings.target_risk, settings.confidence_level)
    least = math.ceil((needed or 0) / (1 - FIT_SHARE_BY_FLIGHT))
    if flights >= least:
        return Unit.FLIGHT
    LOGGER.warning(
        "%d flights are too few to promise anything about the next one (%d are needed, or a larger"
        " --risk): the promise counts frames as independent, which those of one flight are not",
        *(flights, least),
    )
    return Unit.FRAME


def judge(answers: Answers, settings: CalibrationSettings) -> tuple[Judgement, Refusal | None]:
    """Return how one kind of answer is to be judged, and why nothing is accepted if nothing is.

    Raises:
        CalibrationError: there are too few frames to fit anything to.
    """
    by_flight = (settings.unit or default_unit(answers, settings)) is Unit.FLIGHT
    first_share = FIT_SHARE_BY_FLIGHT if by_flight else 0.5
    fitted_on, certified_on = answers.thinned(settings.thin).halves(settings.seed, first_share)
    # rejected whatever their risk, frames still teach what being wrong looks like
    candidates = fitted_on.rows(np.isfinite(fitted_on.error_m))
    if not fitted_on.acceptable.any() or not len(certified_on):
        raise CalibrationError(
            f"{len(answers)} frames, of which {int(answers.acceptable.sum())} have an answer that"
            " truth judges: too few to fit a model on one half and certify it on the other"
        )
    is_error = candidates.is_error(settings.tolerance_m)
    model = fit_risk_model(candidates.signals, is_error)
    fit_risks = acceptance_risks(model, candidates)
    known = fit_risks < 1.0
    risks = acceptance_risks(model, certified_on)
    outcome = certify(
        risks,
        certified_on.is_error(settings.tolerance_m),
        threshold_sequence(fit_risks[known], is_error[known], settings.target_risk),
        settings.target_risk,
        settings.confidence_level,
        certified_on.flight if by_flight else None,
    )
    if isinstance(outcome, Refusal):
        return _judgement(model, NOTHING, candidates, certified_on, risks, settings), outcome
    return _judgement(model, outcome.threshold, candidates, certified_on, risks, settings), None


def acceptance_risks(model: RiskModel, answers: Answers) -> FloatArray:
    """Return the risk of each answer ``(n,)``; 1, never accepted, where no model is asked."""
    return np.where(answers.acceptable, model.risks(answers.signals), 1.0)


def refusal_line(refusal: Refusal, settings: CalibrationSettings) -> str:
    """Return why no threshold was certified, and what would have been enough."""
    least = accepted_needed(settings.target_risk, settings.confidence_level)
    cannot = (
        f"a risk of {settings.target_risk:g} cannot be certified with confidence"
        f" {settings.confidence_level:g}"
    )
    if refusal.mean_share is not None:
        enough = "no number is" if refusal.accepted_needed is None else refusal.accepted_needed
        return (
            f"{cannot}: in {refusal.errors} of {refusal.accepted} flights of which the most"
            f" promising threshold accepts anything, frames are beyond {settings.tolerance_m:g} m,"
            f" a mean share of {refusal.mean_share:.3f}; flights that would be enough with so many:"
            f" {enough}, without any {least}"
        )
    return (
        f"{cannot}: {refusal.errors} of {refusal.accepted} frames that the"
        f" most promising threshold accepts are beyond {settings.tolerance_m:g} m; with so many,"
        f" {refusal.accepted_needed} accepted frames are needed, without any {least}"
    )


def _judgement(
    model: RiskModel,
    max_risk: float,
    candidates: Answers,
    certified_on: Answers,
    risks: FloatArray,
    settings: CalibrationSettings,
) -> Judgement:
    """Return the judgement by a threshold, with its CE90 scale from the frames it accepts."""
    accepted = certified_on.rows(risks <= max_risk)
    needed = accepted.needed_scales()
    scale = conformal_scale(needed)
    has_scale = 0 < scale < math.inf
    return Judgement(
        model=model,
        max_risk=max_risk,
        ce90_scale=scale if has_scale else 1.0,
        fit_frames=len(candidates),
        frames=len(certified_on),
        accepted=len(accepted),
        errors=int(accepted.is_error(settings.tolerance_m).sum()),
        ce90_frames=len(needed) if has_scale else 0,
    )
