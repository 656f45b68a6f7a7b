"""How fast the log's error wanders, as the flight itself tells."""

import logging
from collections.abc import Sequence

import numpy as np

from uasthn_cli.fusion.forward_backward import log_evidence
from uasthn_cli.types import FloatArray, OffsetLikelihood

_log = logging.getLogger(__name__)

CANDIDATES_M_PER_SQRT_S = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0)
DEFAULT_M_PER_SQRT_S = 4.0

_USUAL_LARGEST_M_PER_SQRT_S = 16.0
_LARGEST_PER_RADIUS = 1 / 40
"""Per metre of search radius and root second. Whoever searches far expects an error that wanders
fast (a jammed or spoofed position). Elsewhere such an error would follow every frame's own answer,
also over the map of another place, and the agreement of neighbours would tell nothing."""


def fit_diffusion(
    likelihoods: Sequence[OffsetLikelihood | None],
    times_s: FloatArray,
    speed_m_s: float,
    radius_m: float = 0.0,
) -> float:
    """Return the diffusion (m/√s) under which frames predict one another best.

    A position error cannot wander farther between two frames than the aircraft flies
    (``speed_m_s``, from the log), which bounds it, and hardly as far where the search radius is
    small. A flight of fewer than three frames that say
    anything gets the default.
    """
    steps_s = np.diff(times_s)
    steps_s = steps_s[steps_s > 0]
    if sum(entry is not None for entry in likelihoods) <= 2 or not steps_s.size:
        return DEFAULT_M_PER_SQRT_S
    expected = max(_USUAL_LARGEST_M_PER_SQRT_S, _LARGEST_PER_RADIUS * radius_m)
    largest = min(speed_m_s * float(np.median(steps_s)) ** 0.5, expected)
    within = [value for value in CANDIDATES_M_PER_SQRT_S if value <= largest]
    candidates = within or [CANDIDATES_M_PER_SQRT_S[0]]
    best = candidates[int(np.argmax(log_evidence(likelihoods, times_s, candidates)))]
    _log.info("diffusion of the log's position error: %g m/√s", best)
    return best
