"""Cheap trials: how well a few frames of a flight fit the map together under another assumption."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.fusion.forward_backward import log_evidence
from uasthn_cli.fusion.offsets import OffsetGrid
from uasthn_cli.pipeline.frame_matcher import FrameMatcher, UnmatchableFrameError
from uasthn_cli.pipeline.likelihoods import likelihood_of_match
from uasthn_cli.types import Attitude, OffsetLikelihood, Prior

TRIAL_FRAMES = 12
LEAST_CONTROL_FRAMES = 6
_LEAST_SHARE = 0.6
"""Of the tried frames, that must lie within the log under an assumption."""
_DIFFUSIONS_M_PER_SQRT_S = (1.0, 4.0)
_WHOLE_FRAME = CropTtaConfig(views=1)


@dataclass(frozen=True, slots=True)
class Assumption:
    """What is assumed of all frames, relative to what is stated.

    ``turn_deg`` is added to the mount yaw, ``scale`` multiplies the ground that a frame shows,
    ``added_s`` is added to the frames' times, ``mirrored`` swaps left and right.
    """

    turn_deg: float = 0.0
    scale: float = 1.0
    added_s: float = 0.0
    mirrored: bool = False


class Trials:
    """Scores assumptions on some frames of a flight, each assumption once."""

    def __init__(
        self,
        matcher: FrameMatcher,
        grid: OffsetGrid,
        names: Sequence[str],
        priors_at: Callable[[float], dict[str, Prior]],
        radius_m: float,
    ) -> None:
        """Keep what is tried: frames by ``names``, in order of time, all of them.

        ``priors_at`` gives their priors for a clock.
        """
        self._matcher, self._mirrored = matcher, matcher.of_mirrored_frames()
        self._grid, self._priors_at, self._radius_m = grid, priors_at, radius_m
        self._names = names
        self.scores: dict[Assumption, float] = {}

    @property
    def frames(self) -> int:
        """How many frames are tried."""
        return len(self._names)

    def score(self, assumption: Assumption) -> float:
        """Return the nats per frame by which the frames agree on one slow offset beyond chance."""
        if assumption not in self.scores:
            self.scores[assumption] = self._score(assumption)
        return self.scores[assumption]

    def best(self, assumptions: Sequence[Assumption]) -> Assumption:
        """Return the assumption under which frames fit best."""
        return max(assumptions, key=self.score)

    def _score(self, assumption: Assumption) -> float:
        known = self._priors_at(assumption.added_s)
        priors = [assumed(known[name], assumption) for name in self._names if name in known]
        if len(priors) < _LEAST_SHARE * len(self._names):
            return 0.0
        matcher = self._mirrored if assumption.mirrored else self._matcher
        nats = evidence_nats(priors, matcher, self._grid, self._radius_m)
        return nats / len(self._names)


def evidence_nats(
    priors: Sequence[Prior], matcher: FrameMatcher, grid: OffsetGrid, radius_m: float
) -> float:
    """Return how far frames agree, beyond chance, on one slow error of the log's position."""
    in_time = sorted(priors, key=lambda prior: prior.time_utc_s)
    likelihoods = [_likelihood(prior, matcher, grid, radius_m) for prior in in_time]
    if all(entry is None for entry in likelihoods):
        return 0.0
    times_s = np.array([prior.time_utc_s for prior in in_time])
    return float(log_evidence(likelihoods, times_s, _DIFFUSIONS_M_PER_SQRT_S).max())


def _likelihood(
    prior: Prior, matcher: FrameMatcher, grid: OffsetGrid, radius_m: float
) -> OffsetLikelihood | None:
    try:
        match = matcher.match(prior, _WHOLE_FRAME, radius_m)
    except UnmatchableFrameError:
        return None
    return likelihood_of_match(match, grid, np.zeros(2))


def assumed(prior: Prior, assumption: Assumption) -> Prior:
    """Return a prior turned and scaled as assumed; its time is the caller's to choose."""
    attitude = prior.attitude
    yaw_rad = attitude.yaw_rad + float(np.radians(assumption.turn_deg))
    turned = Attitude(attitude.roll_rad, attitude.pitch_rad, yaw_rad)
    height_m = prior.height_above_ground_m * assumption.scale
    return replace(prior, attitude=turned, height_above_ground_m=height_m)


def tried_and_control(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return names of frames to try assumptions on, and of others to confirm the best on.

    Neighbours tell far more than frames apart: the first are from the middle of the flight, the
    others precede them, empty where there are too few.
    """
    start = max(0, (len(names) - TRIAL_FRAMES) // 2)
    control = list(names[max(0, start - TRIAL_FRAMES) : start])
    tried = list(names[start : start + TRIAL_FRAMES])
    return tried, control if len(control) >= LEAST_CONTROL_FRAMES else []
