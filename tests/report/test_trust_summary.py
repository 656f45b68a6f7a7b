import math
from dataclasses import asdict, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_runs import FIVE_ROWS, fused_rows, make_run

from uasthn_cli.report.intervals import wilson_interval
from uasthn_cli.report.load import RunResults, single_frame_run
from uasthn_cli.report.rows import FrameRow
from uasthn_cli.report.trust_summary import SIGNALS, TrustSummary, summarise_trust


def trust_of(run: RunResults, tolerance_m: float = 25.0) -> TrustSummary:
    found = summarise_trust(run, tolerance_m)
    assert found is not None
    return found


def with_signals(**signals: list[float]) -> RunResults:
    """Return the five frames with signals of the three that have an estimate (CE 4, 30, 100)."""
    values: list[dict[str, Any]] = [
        dict(zip(signals, row, strict=True)) for row in zip(*signals.values(), strict=True)
    ]
    rows = [replace(row, **changes) for row, changes in zip(FIVE_ROWS[:3], values, strict=True)]
    return make_run(*rows, *FIVE_ROWS[3:])


def test_judged_are_answers_with_a_known_error() -> None:
    unlisted = replace(FIVE_ROWS[0], ce_m=math.nan, mace_m=math.nan)
    trust = trust_of(make_run(unlisted, *FIVE_ROWS))
    assert (trust.judged, trust.beyond_tolerance, trust.accepted_risk) == (3, 2, 0.5)


@pytest.mark.parametrize("name", list(SIGNALS))
def test_every_signal_counts_in_its_own_direction(name: str) -> None:
    rising = [0.1, 0.5, 0.9] if SIGNALS[name] > 0 else [0.9, 0.5, 0.1]
    worth = trust_of(with_signals(**{name: rising})).signals[name]
    assert (worth.answers, worth.auc, worth.excess_aurc) == (3, 1.0, 0.0)
    assert worth.aurc == pytest.approx((0 + 1 / 2 + 2 / 3) / 3)
    reversed_worth = trust_of(with_signals(**{name: rising[::-1]})).signals[name]
    assert reversed_worth.auc == 0.0


def test_a_signal_is_judged_on_the_answers_that_have_it() -> None:
    trust = trust_of(with_signals(u_m=[1.0, math.nan, 2.0]))
    assert trust.signals["u_m"].answers == 2
    assert trust.signals["u_m"].auc == 1.0
    nothing = {"answers": 0, "auc": None, "aurc": None, "excess_aurc": None}
    assert asdict(trust.signals["risk"]) == nothing


def test_one_class_has_no_roc_but_a_risk() -> None:
    worth = trust_of(with_signals(risk=[0.1, 0.2, 0.3]), tolerance_m=1000.0).signals["risk"]
    assert (worth.auc, worth.aurc) == (None, 0.0)


def test_ce90_coverage_by_hand() -> None:
    trust = trust_of(with_signals(ce90_m=[5.0, 29.0, 100.0]))
    assert trust.ce90_coverage_all == pytest.approx(2 / 3)
    assert trust.ce90_coverage_accepted == 0.5
    assert trust.coverage_at_levels["0.9"] == trust.ce90_coverage_all
    assert trust.intervals["ce90_coverage_all"] == wilson_interval(2, 3)
    assert trust.intervals["accepted_risk"] == wilson_interval(1, 2)
    assert "camera_ce90_coverage_all" not in trust.intervals
    assert trust.coverage_at_levels["0.95"] == 1.0  # the radii are 1.14 times as large


def test_the_cameras_coverage_is_its_own() -> None:
    radii_m = {"ce90_m": [5.0, 29.0, 100.0], "camera_ce90_m": [9.0, 9.0, 9.0]}
    trust = trust_of(with_signals(**radii_m, camera_ce_m=[8.0, 9.5, math.nan]))
    assert trust.camera_ce90_coverage_all == trust.camera_ce90_coverage_accepted == 0.5
    assert trust.ce90_coverage_all == pytest.approx(2 / 3)
    assert trust_of(with_signals(ce90_m=[5.0, 29.0, 100.0])).camera_ce90_coverage_all is None


def test_risk_is_judged_at_25_m_whatever_the_tolerance() -> None:
    run = with_signals(risk=[0.0, 1.0, 1.0])
    assert trust_of(run).expected_calibration_error == pytest.approx(0.0)
    assert trust_of(run, 1000.0).reliability == trust_of(run).reliability


def test_frames_alone_are_judged_by_themselves() -> None:
    single = single_frame_run(make_run(*fused_rows()))
    assert single is not None
    assert trust_of(single).beyond_tolerance > trust_of(make_run(*fused_rows())).beyond_tolerance


def test_without_truth_there_is_nothing_to_judge() -> None:
    assert summarise_trust(make_run(has_truth=False)) is None
    empty = trust_of(make_run(rows=()))
    assert (empty.judged, empty.accepted_risk, empty.ideal_aurc) == (0, None, None)
    assert empty.ce90_coverage_all is empty.expected_calibration_error is None
    assert empty.reliability == ()


NUMBERS = st.one_of(st.just(math.nan), st.floats(0, 1e6))
ROWS = st.builds(
    FrameRow,
    frame=st.just("x.png"),
    has_estimate=st.booleans(),
    has_prior=st.booleans(),
    accepted=st.booleans(),
    reason=st.just(""),
    ce_m=NUMBERS,
    mace_m=NUMBERS,
    prior_ce_m=NUMBERS,
    confidence=NUMBERS,
    u_m=st.one_of(NUMBERS, st.just(math.inf)),
    risk=st.one_of(st.just(math.nan), st.floats(0, 1)),
    ce90_m=NUMBERS,
)


@given(st.lists(ROWS, max_size=30), st.floats(0.1, 100))
def test_any_run_gives_shares_or_none(rows: list[FrameRow], tolerance_m: float) -> None:
    trust = trust_of(make_run(rows=tuple(rows)), tolerance_m)
    shares = [
        *(trust.accepted_risk, trust.ideal_aurc, trust.expected_calibration_error),
        *(trust.ce90_coverage_all, trust.ce90_coverage_accepted),
        *trust.coverage_at_levels.values(),
        *(figure for worth in trust.signals.values() for figure in (worth.auc, worth.aurc)),
    ]
    assert all(share is None or 0.0 <= share <= 1.0 for share in shares)
