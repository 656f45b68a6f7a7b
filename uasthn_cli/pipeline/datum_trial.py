"""Let frames tell which of two vertical datums the log's heights are in."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from uasthn_cli.fusion.offsets import OffsetGrid, grid_of_radius
from uasthn_cli.ingest.priors import PriorSet
from uasthn_cli.pipeline.frame_matcher import FrameMatcher
from uasthn_cli.pipeline.ground import Ground
from uasthn_cli.pipeline.trials import TRIAL_FRAMES, evidence_nats
from uasthn_cli.types import Prior

_LEAST_MARGIN_NATS = 0.2
"""Per frame, so over two in all. Heights that are 12 % off cost 0.4 on a flight over real pixels,
2 % nothing."""


def likeliest_ground(
    grounds: Sequence[Ground],
    priors: PriorSet,
    matcher: FrameMatcher,
    radius_m: float,
) -> Ground:
    """Return the ground that frames from the middle of the flight fit best.

    ``priors`` are as the log has them. The first of the grounds stands unless another is clearly
    better; the answer's datum says what the frames said.
    """
    if len(grounds) == 1:
        return grounds[0]
    grid = grid_of_radius(radius_m, matcher.pitch_m)
    scores = [_nats_per_frame(ground, priors, matcher, grid, radius_m) for ground in grounds]
    others = np.array(scores[1:])
    best = 1 + int(others.argmax()) if others.max() > scores[0] + _LEAST_MARGIN_NATS else 0
    chosen, rival = grounds[best], max(s for k, s in enumerate(scores) if k != best)
    kinds = " and ".join(str(g.datum.kind) for k, g in enumerate(grounds) if k != best)
    verdict = "frames do not tell them apart, so heights may be off"
    if scores[best] > rival + _LEAST_MARGIN_NATS:
        verdict = "frames fit better"
    why = f"{chosen.datum.why}; {verdict}: {scores[best]:.1f} nats a frame, {rival:.1f} by {kinds}"
    return replace(chosen, datum=replace(chosen.datum, why=why))


def _nats_per_frame(
    ground: Ground, priors: PriorSet, matcher: FrameMatcher, grid: OffsetGrid, radius_m: float
) -> float:
    """Return how far frames agree, beyond chance, on one slow error of the log's position."""
    located = [entry for entry in ground.settled_results(priors) if isinstance(entry, Prior)]
    start = max(0, (len(located) - TRIAL_FRAMES) // 2)
    tried = located[start : start + TRIAL_FRAMES]
    return evidence_nats(tried, matcher, grid, radius_m) / max(1, len(tried))
