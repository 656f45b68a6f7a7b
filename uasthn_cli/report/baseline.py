"""What the navigation prior alone would have given, for comparison."""

import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.report.load import RunResults
from uasthn_cli.report.metrics import Accuracy, accuracy_of, column


def prior_accuracy(run: RunResults, tolerance_m: float = TOLERANCE_M) -> Accuracy | None:
    """Judge the prior on the run's own frames; None without true camera positions.

    Its error is the distance of the prior's camera position from the true one; it has no corners
    and so no MACE. Means, medians and quantiles are over the frames that the run's are over (with
    an estimate, accepted); ``within_all`` is over all frames, one without a prior counting as not
    within.
    """
    if not run.has_prior_error:
        return None
    has_prior = np.array([row.has_prior for row in run.rows], dtype=np.bool_)
    no_corners = np.full(len(run.rows), np.nan)
    ce_m = column(run.rows, "prior_ce_m")
    return accuracy_of(run.rows, ce_m, no_corners, ce_m, has_prior, tolerance_m)
