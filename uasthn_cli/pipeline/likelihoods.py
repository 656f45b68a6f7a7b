"""From an estimator's scores to a likelihood over the log's error."""

from uasthn_cli.fusion.offsets import OffsetGrid, offset_likelihood
from uasthn_cli.pipeline.frame_matcher import FrameMatch
from uasthn_cli.types import FloatArray, OffsetLikelihood


def likelihood_of_match(
    match: FrameMatch, grid: OffsetGrid, centre_m: FloatArray
) -> OffsetLikelihood | None:
    """Return how well a frame fits for every offset; None for an estimator without scores.

    ``centre_m`` ``(2,)`` is how far the prior of the match lies from the log's position.
    """
    scores = match.estimate.scores
    if scores is None:
        return None
    return offset_likelihood(scores, match.scene.placement, grid, centre_m)
