"""What stays wrong throughout a flight: mount yaw, height or field of view, and the clock."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uasthn_cli.seam import Similarity
from uasthn_cli.types import FloatArray

ScoreFrames = Callable[[Sequence[Similarity]], FloatArray]
"""Log-likelihoods ``(F, n)`` of F frames under n hypotheses."""

_ROUNDS = (
    (np.array([math.radians(2.0), 0.025]), 5),
    (np.array([math.radians(0.8), 0.01]), 3),
    (np.array([math.radians(0.3), 0.004]), 3),
)
"""Steps of turn and log scale, and how many each way: from what a log gets wrong downwards."""

_LEAST_GAIN_NATS = 0.6
"""Per frame. Rendered flights with a bias of 2° and 2 % gain 0.6 to 1.0; real ones without any gain
up to 0.57 from patterns that happen to fit, which is no reason to turn a flight."""

_LARGEST = np.array([math.radians(4.5), 0.058])
"""Nearly the edge of the grid: what lies there may lie beyond."""
_LEAST_DEVIATION = np.array([math.radians(1.3), 0.017])
"""Per frame: how turn and scale of real frames scatter about the truth, however well they fit."""

LEAST_FRAMES = 6
_SIGNIFICANT = 3.0


@dataclass(frozen=True, slots=True)
class Constant:
    """A value, its standard error, and how many frames it rests on."""

    value: float
    error: float
    count: int

    @property
    def is_significant(self) -> bool:
        """Tell whether it differs from 0 by more than chance."""
        return self.count >= LEAST_FRAMES and abs(self.value) > _SIGNIFICANT * self.error


@dataclass(frozen=True, slots=True)
class FlightConstants:
    """What a flight's own frames say of its camera and clock; None where too few say anything.

    ``yaw_rad`` is to be added to the logged heading (or the mount yaw), ``log_scale`` to the
    logarithm of the height (or of the tangent of half the field of view), ``clock_s`` to the
    frames' times.
    """

    yaw_rad: Constant | None = None
    log_scale: Constant | None = None
    clock_s: Constant | None = None

    @property
    def yaw_to_apply_rad(self) -> float:
        """Turn that is certain enough to be corrected."""
        return _applied(self.yaw_rad)

    @property
    def scale_to_apply(self) -> float:
        """Factor on the height that is certain enough to be corrected."""
        return math.exp(_applied(self.log_scale))

    @property
    def clock_to_apply_s(self) -> float:
        """Time offset that is certain enough to be corrected."""
        return _applied(self.clock_s)


def constants_of_views(score: ScoreFrames) -> tuple[Constant, Constant] | None:
    """Return the flight's turn (radians) and log scale: where its frames together fit best.

    Scores of all frames are added up over a grid of hypotheses, then over a finer one around its
    peak; so a frame that fits nothing has little to say. Standard errors by the jackknife over
    frames. None where the best lies beyond what a log gets wrong, or hardly fits better than the
    log does.
    """
    middle = np.zeros(2)
    for step, side in _ROUNDS:
        steps = _square(side)
        hypotheses = middle + steps * step
        scores = score([_similarity(*hypothesis) for hypothesis in hypotheses])
        peaks = _leave_one_out_peaks(steps, scores)
        found, middle = middle + peaks * step, middle + paraboloid_peak(steps, scores.sum(0)) * step
    without, with_them = score([Similarity(), _similarity(*middle)]).mean(axis=0)
    if (np.abs(middle) > _LARGEST).any() or with_them - without < _LEAST_GAIN_NATS:
        return None
    count = len(found)
    spread = found - found.mean(axis=0)
    errors = np.sqrt((count - 1) / count * (spread**2).sum(axis=0))
    errors = np.maximum(errors, _LEAST_DEVIATION / math.sqrt(count))
    yaw, log_scale = (
        Constant(float(v), float(e), count) for v, e in zip(middle, errors, strict=True)
    )
    return yaw, log_scale


def paraboloid_peak(steps: FloatArray, scores: FloatArray) -> FloatArray:
    """Return the top ``(2,)`` of the paraboloid through ``scores`` ``(n,)``.

    ``steps`` ``(n, 2)``, fitted around the best score, which is the answer where the top is farther
    than a step from it.
    """
    best: FloatArray = steps[int(scores.argmax())]
    weight = np.exp(-0.5 * ((steps - best) ** 2).sum(axis=1))[:, None]
    x, y = steps.T
    design = np.stack([np.ones_like(x), x, y, x * x, y * y, x * y], axis=1)
    fitted = np.linalg.lstsq(design * weight, (scores - scores.max()) * weight[:, 0], rcond=None)[0]
    bend = np.array([[2 * fitted[3], fitted[5]], [fitted[5], 2 * fitted[4]]])
    if not np.linalg.eigvalsh(bend).max() < 0:
        return best
    top: FloatArray = -np.linalg.solve(bend, fitted[1:3])
    return top if bool((np.abs(top - best) <= 1.0).all()) else best


def _leave_one_out_peaks(steps: FloatArray, scores: FloatArray) -> FloatArray:
    """Return the peaks ``(F, 2)`` of the summed scores ``(F, n)`` without each frame in turn."""
    total = scores.sum(axis=0)
    return np.array([paraboloid_peak(steps, total - own) for own in scores])


def _similarity(yaw_rad: float, log_scale: float) -> Similarity:
    return Similarity(float(yaw_rad), math.exp(log_scale))


def _square(side: int) -> FloatArray:
    """Return the whole steps ``(side², 2)`` of a square around 0."""
    steps = np.arange(side) - side // 2
    return np.array([(a, b) for a in steps for b in steps], dtype=np.float64)


def _applied(constant: Constant | None) -> float:
    return constant.value if constant is not None and constant.is_significant else 0.0
