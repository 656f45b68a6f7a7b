import math
from dataclasses import replace

import pytest
from report_runs import FIVE_ROWS, fused_rows, make_run

from uasthn_cli.report.gates import Gates, missed_gates
from uasthn_cli.report.load import RunResults


@pytest.mark.parametrize(
    ("gates", "missed"),
    [
        (Gates(), None),
        (Gates(min_accepted=0.4), None),
        (Gates(min_accepted=0.41), "accepted fraction 0.400 is below --min-accepted 0.41"),
        (Gates(max_ce_m=17.0), None),
        (Gates(max_ce_m=16.9), "median CE of accepted frames 17.00 m exceeds --max-ce 16.9"),
        (Gates(min_within25=0.5), None),
        (
            Gates(min_within25=0.95),
            "share of accepted frames within 25 m 0.500 is below --min-within25 0.95",
        ),
    ],
)
def test_each_gate_at_its_limit(gates: Gates, missed: str | None) -> None:
    assert missed_gates(make_run(), gates) == ([f"out/run: {missed}"] if missed else [])


def test_all_missed_gates_are_listed() -> None:
    missed = missed_gates(make_run(), Gates(min_accepted=0.9, max_ce_m=1.0, min_within25=0.9))
    assert [phrase.split("--")[1].split()[0] for phrase in missed] == [
        "min-accepted",
        "max-ce",
        "min-within25",
    ]


def test_a_gate_that_needs_truth_is_missed_without_it() -> None:
    run = make_run(has_truth=False)
    assert missed_gates(run, Gates(max_ce_m=1e6, min_within25=0.0)) == [
        "out/run: --max-ce cannot be judged, the run has no truth",
        "out/run: --min-within25 cannot be judged, the run has no truth",
    ]
    assert missed_gates(run, Gates(min_accepted=0.1)) == []


def test_a_gate_on_nothing_is_missed() -> None:
    unaccepted = make_run(*FIVE_ROWS[3:])
    assert missed_gates(unaccepted, Gates(max_ce_m=1e6, min_within25=0.0)) == [
        "out/run: --max-ce cannot be judged, no accepted frame has a true position",
        "out/run: --min-within25 cannot be judged, no accepted frame has a true position",
    ]
    assert missed_gates(make_run(rows=()), Gates(min_accepted=0.0)) == [
        "out/run: accepted fraction of no frames is below --min-accepted 0"
    ]


def with_radius(*ce90_m: float) -> RunResults:
    rows = (replace(row, ce90_m=radius) for row, radius in zip(FIVE_ROWS, ce90_m, strict=True))
    return make_run(*rows)


def test_risk_at_its_limit_and_at_the_tolerance() -> None:
    assert missed_gates(make_run(), Gates(max_risk=0.5)) == []
    assert missed_gates(make_run(), Gates(max_risk=0.49)) == [
        "out/run: share of accepted frames beyond 25 m 0.500 exceeds --max-risk 0.49"
    ]
    assert missed_gates(make_run(), Gates(max_risk=0.0), tolerance_m=30.0) == []
    one_of_twenty = [replace(FIVE_ROWS[0], ce_m=26.0), *[FIVE_ROWS[0]] * 19]
    assert missed_gates(make_run(*one_of_twenty), Gates(max_risk=0.05)) == []


def test_ce90_coverage_at_its_limit() -> None:
    run = with_radius(4.0, 29.0, 200.0, math.nan, math.nan)
    assert missed_gates(run, Gates(min_ce90_coverage=0.5)) == []
    assert missed_gates(run, Gates(min_ce90_coverage=0.51)) == [
        "out/run: share of accepted frames within their CE90 0.500"
        " is below --min-ce90-coverage 0.51"
    ]


def test_gates_of_trust_on_nothing_are_missed() -> None:
    gates = Gates(max_risk=1.0, min_ce90_coverage=0.0)
    for run, nothing in (
        (make_run(has_truth=False), "the run has no truth"),
        (make_run(*FIVE_ROWS[2:]), "no accepted frame has a true position"),
    ):
        assert missed_gates(run, gates) == [
            f"out/run: --max-risk cannot be judged, {nothing}",
            f"out/run: --min-ce90-coverage cannot be judged, {nothing}",
        ]
    assert missed_gates(make_run(), gates) == [
        "out/run: --min-ce90-coverage cannot be judged, no accepted frame states a CE90"
    ]
    assert missed_gates(make_run(*fused_rows()), gates) == []
