"""From an estimator's scores to a likelihood over the log's error."""

from uasthn_cli.fusion.offsets import OffsetGrid, offset_likelihood
from uasthn_cli.pipeline.look import Look
from uasthn_cli.types import FloatArray, OffsetLikelihood


def likelihood_of_look(
    look: Look, grid: OffsetGrid, centre_m: FloatArray
) -> OffsetLikelihood | None:
    """Return how well a frame fits for every offset; None for an estimator without scores.

    ``centre_m`` ``(2,)`` is how far the prior that was looked from lies from the log's position.
    """
    scores = look.estimate.scores
    if scores is None:
        return None
    return offset_likelihood(scores, look.scene.placement, grid, centre_m)
