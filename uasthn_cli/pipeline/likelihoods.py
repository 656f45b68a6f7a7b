"""From an estimator's scores to a likelihood over the log's error."""

from uasthn_cli.fusion.offsets import OffsetGrid, Placement2d, offset_likelihood
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
    gsd_m = look.scene.thermal.gsd_m
    pitch_m = look.scene.features.stride_px * gsd_m
    placement = Placement2d(pitch_m, look.scene.origin_px * gsd_m)
    return offset_likelihood(scores, placement, grid, centre_m)
