"""What a finished run is worth, in numbers: pure functions of its rows."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.report.intervals import (
    Interval,
    mean_interval,
    quantile_interval,
    rms_interval,
    share_intervals,
)
from uasthn_cli.report.load import RunResults
from uasthn_cli.report.rows import FrameRow
from uasthn_cli.types import BoolArray, FloatArray

LEAST_CHECKPOINTS = 30
"""Of fewer, the ASPRS standards of 2023 let nobody claim a class."""


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Mean, median, 90 % quantile (linear) and root mean square of errors in metres.

    ``intervals`` has the 95 % interval of each; None where there are no errors.
    """

    mean_m: float | None = None
    median_m: float | None = None
    p90_m: float | None = None
    rmse_m: float | None = None
    intervals: Mapping[str, Interval] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class HorizontalAccuracy:
    """Horizontal accuracy as the ASPRS Positional Accuracy Standards have it, edition 2 (2023).

    ``rmse_h_m`` is the root of the mean squares in x and y together, over checkpoints whose own
    survey is taken for exact; ``class_m`` the class that it meets, which takes at least 30
    checkpoints: None of fewer.
    """

    checkpoints: int
    rmse_h_m: float | None
    class_m: float | None


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors against truth, of all frames with an estimate and of accepted frames.

    ``within_all`` is the share of all frames, one without an estimate counting as not within the
    tolerance; ``within_accepted`` the share of accepted ones. Frames that have an estimate but no
    true position (``without_truth``) have no part in any of it. ``camera_ce_all`` and
    ``camera_ce_accepted`` are errors of the camera's position, the others' of the frame's centre
    and corners. ``asprs_2023`` takes centres of accepted frames for checkpoints. ``intervals``
    holds the 95 % interval of each share. What has nothing to stand on is None.
    """

    ce_all: ErrorStatistics
    ce_accepted: ErrorStatistics
    mace_all: ErrorStatistics
    mace_accepted: ErrorStatistics
    camera_ce_all: ErrorStatistics
    camera_ce_accepted: ErrorStatistics
    asprs_2023: HorizontalAccuracy
    within_all: float | None
    within_accepted: float | None
    without_truth: int
    intervals: Mapping[str, Interval]


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
    they come from; ``intervals`` holds the 95 % interval of the accepted fraction; ``accuracy`` is
    None for a run without truth.
    """

    frames: int
    with_estimate: int
    accepted: int
    accepted_fraction: float | None
    intervals: Mapping[str, Interval]
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
        accepted_fraction=share_of(accepted),
        intervals=share_intervals(accepted_fraction=accepted),
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
    within_all, within_accepted = within[judged], within[judged & accepted]
    return Accuracy(
        ce_all=_statistics(ce_m[estimated]),
        ce_accepted=_statistics(ce_m[accepted]),
        mace_all=_statistics(mace_m[estimated]),
        mace_accepted=_statistics(mace_m[accepted]),
        camera_ce_all=_statistics(camera_ce_m[estimated]),
        camera_ce_accepted=_statistics(camera_ce_m[accepted]),
        asprs_2023=_horizontal_accuracy(ce_m[accepted]),
        within_all=share_of(within_all),
        within_accepted=share_of(within_accepted),
        without_truth=int((~judged).sum()),
        intervals=share_intervals(within_all=within_all, within_accepted=within_accepted),
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
    """Return mean, median, 90 % quantile and root mean square of the finite errors."""
    finite = errors_m[np.isfinite(errors_m)]
    if finite.size == 0:
        return ErrorStatistics()
    median, p90 = np.percentile(finite, [50.0, 90.0])
    intervals = {
        "mean_m": mean_interval(finite),
        "median_m": quantile_interval(finite, 0.5),
        "p90_m": quantile_interval(finite, 0.9),
        "rmse_m": rms_interval(finite),
    }
    return ErrorStatistics(
        mean_m=float(finite.mean()),
        median_m=float(median),
        p90_m=float(p90),
        rmse_m=_root_mean_square(finite),
        intervals={name: interval for name, interval in intervals.items() if interval},
    )


def _horizontal_accuracy(ce_m: FloatArray) -> HorizontalAccuracy:
    """Return what the centres of frames, those that are known, are worth as checkpoints."""
    finite = ce_m[np.isfinite(ce_m)]
    rmse_h_m = _root_mean_square(finite) if finite.size else None
    class_m = None
    if rmse_h_m is not None and finite.size >= LEAST_CHECKPOINTS:
        class_m = math.ceil(rmse_h_m * 100.0) / 100.0  # classes are told in whole centimetres
    return HorizontalAccuracy(int(finite.size), rmse_h_m, class_m)


def _root_mean_square(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(values**2)))


def share_of(flags: BoolArray) -> float | None:
    """Return the share that is true; None of nothing."""
    return float(flags.mean()) if flags.size else None
