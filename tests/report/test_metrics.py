import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_runs import FIVE_ROWS, make_run

from uasthn_cli.report.baseline import prior_accuracy
from uasthn_cli.report.intervals import (
    mean_interval,
    quantile_interval,
    rms_interval,
    wilson_interval,
)
from uasthn_cli.report.load import RunResults
from uasthn_cli.report.metrics import Accuracy, ErrorStatistics, HorizontalAccuracy, summarise
from uasthn_cli.report.rows import FrameRow

NOTHING = ErrorStatistics()


def figures(found: ErrorStatistics) -> tuple[float | None, ...]:
    return found.mean_m, found.median_m, found.p90_m, found.rmse_m


def accuracy(run: RunResults, tolerance_m: float = 25.0) -> Accuracy:
    found = summarise(run, tolerance_m).accuracy
    assert found is not None
    return found


def test_counts_by_hand() -> None:
    summary = summarise(make_run())
    assert (summary.frames, summary.with_estimate, summary.accepted) == (5, 3, 2)
    assert summary.accepted_fraction == 0.4
    assert summary.reasons == {"off-map": 2, "uncertain": 1}


def test_errors_by_hand() -> None:
    found = accuracy(make_run())
    assert figures(found.ce_all) == pytest.approx(
        (134 / 3, 30.0, 30 + 0.8 * 70, math.sqrt((16 + 900 + 10_000) / 3))
    )
    assert figures(found.ce_accepted) == pytest.approx(
        (17.0, 17.0, 4 + 0.9 * 26, math.sqrt((16 + 900) / 2))
    )
    assert figures(found.mace_all)[:3] == pytest.approx((136 / 3, 20.0, 20 + 0.8 * 90))
    assert figures(found.mace_accepted)[:3] == pytest.approx((13.0, 13.0, 6 + 0.9 * 14))


def test_every_figure_has_its_interval() -> None:
    rows = [replace(FIVE_ROWS[0], ce_m=float(k), camera_ce_m=k + 2.0) for k in range(1, 60)]
    found = accuracy(make_run(*rows))
    errors_m = np.arange(1.0, 60.0)
    assert found.ce_accepted.intervals == {
        "mean_m": mean_interval(errors_m),
        "median_m": quantile_interval(errors_m, 0.5),
        "p90_m": quantile_interval(errors_m, 0.9),
        "rmse_m": rms_interval(errors_m),
    }
    assert found.intervals["within_all"] == wilson_interval(25, 59)
    summary = summarise(make_run())
    assert summary.intervals == {"accepted_fraction": wilson_interval(2, 5)}


@pytest.mark.parametrize(("checkpoints", "class_m"), [(29, None), (30, 7.08)])
def test_no_asprs_class_is_claimed_below_30_checkpoints(
    checkpoints: int, class_m: float | None
) -> None:
    rows = [replace(FIVE_ROWS[0], ce_m=math.sqrt(50.0))] * checkpoints
    rejected = replace(FIVE_ROWS[2], ce_m=1e3)
    found = accuracy(make_run(*rows, rejected)).asprs_2023
    assert (found.checkpoints, found.class_m) == (checkpoints, class_m)
    assert found.rmse_h_m == pytest.approx(math.sqrt(50.0))
    assert accuracy(make_run(*FIVE_ROWS[3:])).asprs_2023 == HorizontalAccuracy(0, None, None)


def test_camera_errors_are_told_apart_from_the_centres() -> None:
    rows = [replace(row, camera_ce_m=row.ce_m + 10.0) for row in FIVE_ROWS]
    found = accuracy(make_run(*rows))
    assert (found.camera_ce_all.median_m, found.camera_ce_accepted.median_m) == (40.0, 27.0)
    assert found.ce_all.median_m == 30.0
    assert accuracy(make_run()).camera_ce_all == NOTHING


@pytest.mark.parametrize(
    ("tolerance_m", "within_all", "within_accepted"),
    [(25.0, 0.2, 0.5), (30.0, 0.4, 1.0), (29.999, 0.2, 0.5), (1000.0, 0.6, 1.0), (1.0, 0.0, 0.0)],
)
def test_shares_within_the_tolerance(
    tolerance_m: float, within_all: float, within_accepted: float
) -> None:
    found = accuracy(make_run(), tolerance_m)
    assert (found.within_all, found.within_accepted) == (within_all, within_accepted)


def test_without_truth_there_is_no_accuracy() -> None:
    rows = [replace(row, ce_m=math.nan, mace_m=math.nan) for row in FIVE_ROWS]
    summary = summarise(make_run(*rows, has_truth=False, has_prior_error=False))
    assert summary.accuracy is None
    assert summary.accepted_fraction == 0.4


def test_an_estimate_that_truth_does_not_list_has_no_part_in_shares() -> None:
    unlisted = replace(FIVE_ROWS[0], ce_m=math.nan, mace_m=math.nan, prior_ce_m=math.nan)
    found = accuracy(make_run(unlisted, *FIVE_ROWS[1:]), 30.0)
    assert found.without_truth == 1
    assert found.within_all == 0.25
    assert found.within_accepted == 1.0
    assert found.ce_accepted.mean_m == 30.0


def test_nothing_accepted_and_nothing_at_all() -> None:
    found = accuracy(make_run(*FIVE_ROWS[3:]))
    assert found.ce_all == found.ce_accepted == found.mace_all == NOTHING
    assert (found.within_all, found.within_accepted) == (0.0, None)
    empty = summarise(make_run(rows=()))
    assert (empty.frames, empty.accepted_fraction, empty.reasons) == (0, None, {})
    assert empty.accuracy is not None
    assert empty.accuracy.within_all is None


def test_prior_on_the_same_frames_by_hand() -> None:
    found = prior_accuracy(make_run())
    assert found is not None
    assert found.ce_all.mean_m == found.ce_all.median_m == 40.0
    assert found.camera_ce_all == found.ce_all  # the log's position is the camera's
    assert found.ce_accepted.median_m == 30.0
    assert found.within_all == 0.4  # b at 20 m; d, where the run has no estimate, at 10 m
    assert found.within_accepted == 0.5
    assert found.mace_all == found.mace_accepted == NOTHING
    assert found.without_truth == 0


def test_prior_needs_true_camera_positions() -> None:
    assert prior_accuracy(make_run(has_prior_error=False)) is None


def test_prior_without_a_true_position_is_left_out_not_counted_as_wrong() -> None:
    unlisted = replace(FIVE_ROWS[0], prior_ce_m=math.nan)
    found = prior_accuracy(make_run(unlisted, *FIVE_ROWS[1:]))
    assert found is not None
    assert found.without_truth == 1
    assert found.within_all == 0.5


ERRORS = st.one_of(st.just(math.nan), st.floats(0, 1e6))
ROWS = st.builds(
    FrameRow,
    frame=st.just("x.png"),
    has_estimate=st.booleans(),
    has_prior=st.booleans(),
    accepted=st.booleans(),
    reason=st.sampled_from(["", "uncertain", "off-map"]),
    ce_m=ERRORS,
    mace_m=ERRORS,
    prior_ce_m=ERRORS,
)


@given(st.lists(ROWS, max_size=12), st.floats(0.1, 100))
def test_any_run_gives_finite_numbers_or_none(rows: list[FrameRow], tolerance_m: float) -> None:
    run = make_run(rows=tuple(rows))
    for found in (accuracy(run, tolerance_m), prior_accuracy(run, tolerance_m)):
        assert found is not None
        for share in (found.within_all, found.within_accepted):
            assert share is None or 0.0 <= share <= 1.0
        for statistics in (found.ce_all, found.ce_accepted, found.mace_all, found.mace_accepted):
            assert all(v is None or math.isfinite(v) for v in figures(statistics))
            for low, high in statistics.intervals.values():
                assert high is None or 0.0 <= low <= high < math.inf
