"""From signals to trust: covariance, CE90, risk, and what rejects."""

import math
from dataclasses import dataclass

import numpy as np

from uasthn_cli.config import MIN_SUPPORT, GeotagConfig
from uasthn_cli.fusion.offsets import (
    PosteriorSummary,
    ce90_of,
    map_variance_m2,
    posterior_of,
    summarise_posterior,
)
from uasthn_cli.geometry.camera_error import camera_covariance_m2
from uasthn_cli.types import Attitude, FloatArray, OffsetLikelihood, Reason, Trust
from uasthn_cli.uncertainty.calibration import Calibration, Judgement
from uasthn_cli.uncertainty.decide import Rejection, rejection, told_apart


@dataclass(frozen=True, slots=True)
class Agreement:
    """Distance of a frame's own and the flight's answer; share of near frames that agree."""

    distance_m: float
    support: float


ALONE = Agreement(math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class CameraTrust:
    """Covariance ``(2, 2)`` (east, north) of a camera's position, and its 90 % radius."""

    covariance_m2: FloatArray
    ce90_m: float


class TrustModel:
    """Says how far to trust answers, by a calibration, or by plain limits where there is none."""

    def __init__(
        self, config: GeotagConfig, calibration: Calibration | None, map_pixel_m: float
    ) -> None:
        """Keep limits, calibration, and what the map leaves open whatever is found on it."""
        self._config = config
        self._map_variance_m2 = map_variance_m2(config.map_error_m, map_pixel_m)
        self._single = None if calibration is None else calibration.single
        self._fused = None if calibration is None else calibration.fused or calibration.single

    def single(
        self,
        likelihood: OffsetLikelihood | None,
        offset_m: FloatArray,
        uncertainty_m: float,
        confidence: float,
        std_m: FloatArray,
    ) -> Trust:
        """Return what is known of a frame's own answer ``offset_m`` from the log's position.

        An estimator without scores states its confidence; its views' spread ``std_m`` ``(4, 2)``
        stands in for the posterior's.
        """
        if likelihood is None:
            variances = (std_m**2).mean(axis=0)
            summary = PosteriorSummary(confidence, math.nan, math.nan, np.diag(variances))
        else:
            posterior = posterior_of(likelihood)
            summary = summarise_posterior(
                posterior, likelihood.cell_m, likelihood.centre_m, offset_m
            )
        signals = _signals(summary) | {"u_m": uncertainty_m}
        return self._trust(summary, summary.covariance_m2, signals, self._single, ALONE)

    def fused(
        self,
        summary: PosteriorSummary,
        covariance_m2: FloatArray,
        agreement: Agreement,
        uncertainty_m: float,
    ) -> Trust:
        """Return what is known of a fused answer.

        ``summary`` is that of the posterior over the whole search area, ``covariance_m2`` of the
        one near the answer, ``uncertainty_m`` that of the frame's own answer.
        """
        signals = _signals(summary) | {
            "agreement_m": agreement.distance_m,
            "support": agreement.support,
            "u_m": uncertainty_m,
        }
        return self._trust(summary, covariance_m2, signals, self._fused, agreement)

    def camera(
        self,
        centre: Trust,
        attitude: Attitude,
        height_m: float,
        tilt_covariance_rad2: FloatArray | None = None,
    ) -> CameraTrust:
        """Return what is known of the error of the camera's position.

        ``attitude`` is the camera's, the top of its image forward. ``tilt_covariance_rad2``
        ``(2, 2)`` of roll and pitch is what the flight tells of its error; without it (None) each
        is as uncertain as the configuration says.
        """
        if tilt_covariance_rad2 is None:
            tilt_covariance_rad2 = np.eye(2) * math.radians(self._config.attitude_error_deg) ** 2
        covariance_m2 = camera_covariance_m2(
            centre.covariance_m2, tilt_covariance_rad2, attitude, height_m
        )
        return CameraTrust(covariance_m2, ce90_of(covariance_m2))

    def rejection_of_single(
        self, uncertainty_m: float, trust: Trust, window_m: float
    ) -> Rejection | None:
        """Return why a frame's own answer is not to be trusted, or None."""
        limit = None if self._single is None else self._single.max_risk
        config = self._config.decision
        return rejection(uncertainty_m, trust.confidence, trust.risk, window_m, config, limit)

    def rejection_of_fused(self, trust: Trust) -> Rejection | None:
        """Return why a fused answer is not to be trusted, or None; its views' spread plays no part.

        Whatever the calibration says, most near frames must agree alone.
        """
        if not trust.support > MIN_SUPPORT:
            found, least = told_apart(trust.support, MIN_SUPPORT)
            return Rejection(Reason.UNSUPPORTED, f"support {found}, more than {least} needed")
        config = self._config.decision
        limit = None if self._fused is None else self._fused.max_risk
        return rejection(0.0, trust.confidence, trust.risk, 0.0, config, limit)

    def _trust(
        self,
        summary: PosteriorSummary,
        covariance_m2: FloatArray,
        signals: dict[str, float],
        judgement: Judgement | None,
        agreement: Agreement,
    ) -> Trust:
        scale = 1.0 if judgement is None else judgement.ce90_scale
        covariance_m2 = covariance_m2 * scale**2 + np.eye(2) * self._map_variance_m2
        return Trust(
            confidence=summary.confidence,
            entropy_nats=summary.entropy_nats,
            sigma_m=summary.sigma_m,
            covariance_m2=covariance_m2,
            ce90_m=ce90_of(covariance_m2),
            risk=math.nan if judgement is None else judgement.model.risk(signals),
            agreement_m=agreement.distance_m,
            support=agreement.support,
        )


def _signals(summary: PosteriorSummary) -> dict[str, float]:
    return {
        "confidence": summary.confidence,
        "entropy": summary.entropy_nats,
        "sigma_m": summary.sigma_m,
    }
