"""What a finished run is worth, in numbers: pure functions of its rows."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.report.load import RunResults
from uasthn_cli.report.rows import FrameRow
from uasthn_cli.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Mean, median and 90 % quantile (linear) of errors in metres; None where there are none."""

    mean_m: float | None
    median_m: float | None
    p90_m: float | None


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors against truth, of all frames with an estimate and of accepted frames.

    ``within_all`` is the share of all frames, one without an estimate counting as not within the
    tolerance; ``within_accepted`` the share of accepted ones. Frames that have an estimate but no
    true position (``without_truth``) have no part in any of it. ``camera_ce_all`` and
    ``camera_ce_accepted`` are errors of the camera's position, the others' of the frame's centre
    and corners. What has nothing to stand on is None.
    """

    ce_all: ErrorStatistics
    ce_accepted: ErrorStatistics
    mace_all: ErrorStatistics
    mace_accepted: ErrorStatistics
    camera_ce_all: ErrorStatistics
    camera_ce_accepted: ErrorStatistics
    within_all: float | None
    within_accepted: float | None
    without_truth: int


@dataclass(frozen=True, slots=True)
class Example:
    """A frame that was not accepted, and in one line what was missing."""

    frame: str
    detail: str


@dataclass(frozen=True, slots=True)
class Summary:
    """One run. ``accepted_fraction`` (of all frames) is what the paper calls success rate.

    ``reasons`` counts frames by the reason for which they were rejected or have no estimate, and
    ``examples`` has the first frame of each that says more; ``sources`` counts estimates by where
    they come from; ``accuracy`` is None for a run without truth.
    """

    frames: int
    with_estimate: int
    accepted: int
    accepted_fraction: float | None
    reasons: Mapping[str, int]
    examples: Mapping[str, Example]
    sources: Mapping[str, int]
    tolerance_m: float
    accuracy: Accuracy | None


def summarise(run: RunResults, tolerance_m: float = TOLERANCE_M) -> Summary:
    """Summarise a run; ``tolerance_m`` is the CE up to which a frame counts as found."""
    accepted = _flags(run.rows, "accepted")
    reasons = Counter(row.reason for row in run.rows if row.reason)
    sources = Counter(row.source for row in run.rows if row.source and row.has_estimate)
    return Summary(
        frames=len(run.rows),
        with_estimate=int(_flags(run.rows, "has_estimate").sum()),
        accepted=int(accepted.sum()),
        accepted_fraction=_share(accepted),
        reasons=dict(sorted(reasons.items())),
        examples=_examples(run.rows),
        sources=dict(sorted(sources.items())),
        tolerance_m=tolerance_m,
        accuracy=_run_accuracy(run, tolerance_m) if run.has_truth else None,
    )


def _examples(rows: Sequence[FrameRow]) -> dict[str, Example]:
    """Return the first frame of each reason that says more than the reason."""
    explained = [row for row in rows if row.reason and row.detail]
    first = {row.reason: Example(row.frame, row.detail) for row in reversed(explained)}
    return dict(sorted(first.items()))


def accuracy_of(
    rows: Sequence[FrameRow],
    ce_m: FloatArray,
    mace_m: FloatArray,
    camera_ce_m: FloatArray,
    has_answer: BoolArray,
    tolerance_m: float,
) -> Accuracy:
    """Judge answers with errors ``(n,)`` of centre, corners and camera, NaN where there is none.

    ``has_answer`` ``(n,)`` tells an answer that no truth judges from the absence of an answer.
    Errors are taken over the rows' own estimates, so that rivals are compared on the same frames.
    """
    estimated, accepted = _flags(rows, "has_estimate"), _flags(rows, "accepted")
    judged = np.isfinite(ce_m) | ~has_answer
    within = ce_m <= tolerance_m
    return Accuracy(
        ce_all=_statistics(ce_m[estimated]),
        ce_accepted=_statistics(ce_m[accepted]),
        mace_all=_statistics(mace_m[estimated]),
        mace_accepted=_statistics(mace_m[accepted]),
        camera_ce_all=_statistics(camera_ce_m[estimated]),
        camera_ce_accepted=_statistics(camera_ce_m[accepted]),
        within_all=_share(within[judged]),
        within_accepted=_share(within[judged & accepted]),
        without_truth=int((~judged).sum()),
    )


def column(rows: Sequence[FrameRow], name: str) -> FloatArray:
    """Return one number per row ``(n,)``."""
    return np.array([getattr(row, name) for row in rows], dtype=np.float64)


def _run_accuracy(run: RunResults, tolerance_m: float) -> Accuracy:
    """Judge a run's own estimates."""
    ce_m, mace_m = column(run.rows, "ce_m"), column(run.rows, "mace_m")
    camera_ce_m, has_answer = column(run.rows, "camera_ce_m"), _flags(run.rows, "has_estimate")
    return accuracy_of(run.rows, ce_m, mace_m, camera_ce_m, has_answer, tolerance_m)


def _flags(rows: Sequence[FrameRow], name: str) -> BoolArray:
    """Return one flag per row ``(n,)``."""
    return np.array([getattr(row, name) for row in rows], dtype=np.bool_)


def _statistics(errors_m: FloatArray) -> ErrorStatistics:
    """Return mean, median and 90 % quantile of the finite errors."""
    finite = errors_m[np.isfinite(errors_m)]
    if finite.size == 0:
        return ErrorStatistics(mean_m=None, median_m=None, p90_m=None)
    median, p90 = np.percentile(finite, [50.0, 90.0])
    return ErrorStatistics(mean_m=float(finite.mean()), median_m=float(median), p90_m=float(p90))


def _share(flags: BoolArray) -> float | None:
    """Return the share that is true; None of nothing."""
    return float(flags.mean()) if flags.size else None
