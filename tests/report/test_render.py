import json
import math
from dataclasses import replace

import pytest
from report_runs import FIVE_ROWS, fused_rows, make_run

from uasthn_cli.report.baseline import prior_accuracy
from uasthn_cli.report.load import RunResults, single_frame_run
from uasthn_cli.report.metrics import summarise
from uasthn_cli.report.render import (
    ReportColumn,
    reasons_in_words,
    report_json,
    report_table,
)
from uasthn_cli.report.trust_summary import summarise_trust


def column(run: RunResults, with_prior: bool = False) -> ReportColumn:
    prior = prior_accuracy(run) if with_prior else None
    single = single_frame_run(run)
    return ReportColumn(
        run.name,
        run.version,
        summarise(run),
        prior,
        summarise_trust(run),
        column(single) if single else None,
    )


def as_dict(rows: list[list[str]], index: int) -> dict[str, str]:
    return {row[0]: row[index] for row in rows}


def test_one_run_shows_every_figure() -> None:
    header, *rows = report_table([column(make_run())])
    assert header == ["", "out/run"]
    assert rows == [
        ["frames", "5"],
        ["with estimate", "3"],
        ["accepted", "2"],
        ["accepted fraction", "0.400 (0.118–0.769)"],
        ["reason: off-map", "2"],
        ["reason: uncertain", "1"],
        ["MACE mean, all [m]", "45.33 (0.00–185.53)"],
        ["MACE median, all [m]", "20.00"],
        ["MACE 90 %, all [m]", "92.00 (6.00–∞)"],
        ["CE mean, all [m]", "44.67 (0.00–168.01)"],
        ["CE RMSE, all [m]", "60.32 (0.00–131.79)"],
        ["CE median, all [m]", "30.00"],
        ["CE 90 %, all [m]", "86.00 (4.00–∞)"],
        ["MACE mean, accepted [m]", "13.00 (0.00–101.94)"],
        ["MACE median, accepted [m]", "13.00"],
        ["MACE 90 %, accepted [m]", "18.60 (6.00–∞)"],
        ["CE mean, accepted [m]", "17.00 (0.00–182.18)"],
        ["CE RMSE, accepted [m]", "21.40 (0.00–77.94)"],
        ["CE median, accepted [m]", "17.00"],
        ["CE 90 %, accepted [m]", "27.40 (4.00–∞)"],
        ["ASPRS class, accepted [m]", "none (2 of 30 checkpoints)"],
        ["within 25 m, all", "0.200 (0.036–0.624)"],
        ["within 25 m, accepted", "0.500 (0.095–0.905)"],
    ]


def test_runs_with_and_without_truth_stand_side_by_side() -> None:
    plain = make_run(*FIVE_ROWS[:2], name="plain", has_truth=False)
    rows = report_table([column(plain), column(make_run())])
    assert rows[0] == ["", "plain", "out/run"]
    assert all(len(row) == 3 for row in rows)
    first, second = as_dict(rows, 1), as_dict(rows, 2)
    assert (first["CE median, all [m]"], second["CE median, all [m]"]) == ("-", "30.00")
    assert (first["reason: off-map"], second["reason: off-map"]) == ("0", "2")
    labels = list(first)
    assert labels.index("reason: uncertain") < labels.index("MACE mean, all [m]")


def test_rows_keep_their_places_whichever_run_has_the_camera() -> None:
    labels = [row[0] for row in report_table([column(make_run()), column(make_run(*fused_rows()))])]
    known = [row[0] for row in report_table([column(make_run(*fused_rows()))])]
    assert [label for label in labels if not label.startswith("reason")] == [
        label for label in known if not label.startswith("reason")
    ]


def test_the_prior_stands_beside_its_run() -> None:
    rows = report_table([column(make_run(), with_prior=True), column(make_run(name="two"))])
    assert rows[0] == ["", "out/run", "prior of out/run", "two"]
    prior = as_dict(rows, 2)
    assert prior["CE median, all [m]"] == "40.00"
    assert prior["MACE median, all [m]"] == prior["accepted"] == prior["reason: off-map"] == "-"


def test_json_has_the_same_keys_whatever_is_known() -> None:
    runs = [make_run(), make_run(rows=(), name="empty"), make_run(has_truth=False)]
    columns = [column(run, with_prior=k == 0) for k, run in enumerate(runs)]
    full, empty, plain = json.loads(report_json(columns))
    assert list(full) == list(empty) == list(plain)
    assert list(full) == [
        *("run", "version", "frames", "with_estimate", "accepted", "accepted_fraction"),
        *(
            "intervals",
            "reasons",
            "examples",
            "sources",
            "tolerance_m",
            "accuracy",
            "baseline_prior",
            "trust",
        ),
        "single",
    ]
    assert list(full["trust"]) == list(empty["trust"])
    assert plain["trust"] is full["single"] is None
    assert list(full["accuracy"]) == list(empty["accuracy"]) == list(full["baseline_prior"])
    accepted, nothing = full["accuracy"]["ce_accepted"], empty["accuracy"]["ce_accepted"]
    assert list(accepted) == list(nothing)
    assert (accepted["mean_m"], accepted["median_m"], accepted["p90_m"]) == (17.0, 17.0, 27.4)
    assert accepted["intervals"]["median_m"] == [0.0, None]  # two errors leave everything open
    assert (nothing["mean_m"], nothing["rmse_m"], nothing["intervals"]) == (None, None, {})
    assert full["accuracy"]["asprs_2023"]["class_m"] is None
    assert full["accuracy"]["intervals"]["within_all"] == pytest.approx([0.036, 0.624], abs=1e-3)
    assert plain["accuracy"] is None
    assert plain["baseline_prior"] is None


def test_estimates_without_truth_are_owned_up_to() -> None:
    unlisted = replace(FIVE_ROWS[0], ce_m=math.nan, mace_m=math.nan)
    rows = report_table([column(make_run(unlisted, *FIVE_ROWS[1:]))])
    assert as_dict(rows, 1)["estimates without truth"] == "1"
    assert "estimates without truth" not in as_dict(report_table([column(make_run())]), 1)


def test_fused_and_single_answers_stand_under_each_other() -> None:
    run = make_run(*fused_rows())
    cells = as_dict(report_table([column(run)]), 1)
    single = single_frame_run(run)
    assert single is not None
    alone = as_dict(report_table([column(single)]), 1)
    labels = [label for label in cells if label.startswith("single: ")]
    assert labels == [
        "single: accepted fraction",
        *("single: CE median, all [m]", "single: CE 90 %, all [m]"),
        *("single: CE median, accepted [m]", "single: CE 90 %, accepted [m]"),
        *("single: within 25 m, all", "single: within 25 m, accepted"),
    ]
    assert all(cells[label] == alone[label.removeprefix("single: ")] for label in labels)
    shares = [cells[f"{kind}within 25 m, all"].split()[0] for kind in ("", "single: ")]
    assert float(shares[0]) > float(shares[1])


def test_trust_is_shown_when_asked_for() -> None:
    fused, plain = make_run(*fused_rows()), make_run(name="plain")
    columns = [column(fused), column(plain), column(make_run(has_truth=False))]
    rows = report_table(columns, with_trust=True)
    cells, others, untrue = (as_dict(rows, k) for k in (1, 2, 3))
    assert (cells["source: fix"], cells["source: flight"]) == ("30", "30")
    trust = columns[0].trust
    assert trust is not None
    assert cells["judged, beyond 25 m"] == f"{trust.beyond_tolerance} of 60"
    assert cells["AUC of risk"] == f"{trust.signals['risk'].auc:.3f}"
    assert cells["AURC by risk"] == f"{trust.signals['risk'].aurc:.3f}"
    assert cells["calibration error of risk"] == f"{trust.expected_calibration_error:.3f}"
    assert cells["single: AUC of risk"] != cells["AUC of risk"]
    assert "AUC of agreement_m" not in cells  # no run has it
    assert others["judged, beyond 25 m"] == "2 of 3"
    assert others["AUC of risk"] == others["single: AUC of risk"] == others["source: fix"] == "-"
    assert untrue["judged, beyond 25 m"] == untrue["AUC of risk"] == "-"
    assert "AUC of risk" not in as_dict(report_table(columns), 1)


def test_errors_and_coverage_of_centre_and_camera_are_always_shown() -> None:
    fused = column(make_run(*fused_rows()))
    cells = as_dict(report_table([fused]), 1)
    trust, accuracy = fused.trust, fused.summary.accuracy
    assert trust is not None
    assert accuracy is not None
    expected = {
        "camera CE median, accepted [m]": f"{accuracy.camera_ce_accepted.median_m:.2f}",
        "CE90 coverage, all": f"{trust.ce90_coverage_all:.3f}",
        "CE90 coverage, accepted": f"{trust.ce90_coverage_accepted:.3f}",
        "camera CE90 coverage, accepted": f"{trust.camera_ce90_coverage_accepted:.3f}",
    }
    assert {label: cells[label].split(" (")[0] for label in expected} == expected
    low, high = trust.intervals["camera_ce90_coverage_accepted"]
    assert cells["camera CE90 coverage, accepted"].endswith(f" ({low:.3f}–{high:.3f})")
    assert cells["camera CE90 coverage, accepted"] != cells["CE90 coverage, accepted"]


def test_an_interval_that_is_open_at_the_top_says_so() -> None:
    rows = [replace(FIVE_ROWS[0], ce_m=float(k)) for k in range(1, 21)]
    cells = as_dict(report_table([column(make_run(*rows))]), 1)
    assert cells["CE 90 %, accepted [m]"] == "18.10 (15.00–∞)"


def test_the_commonest_reasons_are_told_with_an_example_of_what_was_missing() -> None:
    details = {"c.png": "frame and views disagree by 12 m", "d.png": "", "e.png": "no map there"}
    rows = [replace(row, detail=details.get(row.frame, "")) for row in FIVE_ROWS]
    one = column(make_run(*rows))
    assert reasons_in_words([one]) == [
        "2 off-map, for example e.png: no map there",
        "1 uncertain, for example c.png: frame and views disagree by 12 m",
    ]
    first, *_ = reasons_in_words([one, column(make_run(name="two"))])
    assert first.startswith("out/run: 2 off-map")
    (figures,) = json.loads(report_json([one]))
    assert figures["examples"]["off-map"] == {"frame": "e.png", "detail": "no map there"}
    rows = [replace(row, reason=f"r{k}", detail="why") for k, row in enumerate(FIVE_ROWS)]
    assert len(reasons_in_words([column(make_run(*rows))])) == 3


def test_a_figure_of_some_answers_says_of_how_many() -> None:
    rows = fused_rows()
    rows = (replace(rows[0], risk=math.nan), *rows[1:])
    cells = as_dict(report_table([column(make_run(*rows))], with_trust=True), 1)
    assert cells["AUC of risk"].endswith(" (of 59)")
    assert "of" not in cells["AUC of confidence"]
