import json
import math
from dataclasses import replace

from report_runs import FIVE_ROWS, make_run

from uasthn_cli.report.baseline import prior_accuracy
from uasthn_cli.report.load import RunResults
from uasthn_cli.report.metrics import summarise
from uasthn_cli.report.render import ReportColumn, report_json, report_table


def column(run: RunResults, with_prior: bool = False) -> ReportColumn:
    prior = prior_accuracy(run) if with_prior else None
    return ReportColumn(run.name, run.version, summarise(run), prior)


def as_dict(rows: list[list[str]], index: int) -> dict[str, str]:
    return {row[0]: row[index] for row in rows}


def test_one_run_shows_every_figure() -> None:
    header, *rows = report_table([column(make_run())])
    assert header == ["", "out/run"]
    assert rows == [
        ["frames", "5"],
        ["with estimate", "3"],
        ["accepted", "2"],
        ["accepted fraction", "0.400"],
        ["reason: off-map", "2"],
        ["reason: uncertain", "1"],
        ["MACE mean, all [m]", "45.33"],
        ["MACE median, all [m]", "20.00"],
        ["MACE 90 %, all [m]", "92.00"],
        ["CE mean, all [m]", "44.67"],
        ["CE median, all [m]", "30.00"],
        ["CE 90 %, all [m]", "86.00"],
        ["MACE mean, accepted [m]", "13.00"],
        ["MACE median, accepted [m]", "13.00"],
        ["MACE 90 %, accepted [m]", "18.60"],
        ["CE mean, accepted [m]", "17.00"],
        ["CE median, accepted [m]", "17.00"],
        ["CE 90 %, accepted [m]", "27.40"],
        ["within 25 m, all", "0.200"],
        ["within 25 m, accepted", "0.500"],
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
        *("reasons", "tolerance_m", "accuracy", "baseline_prior"),
    ]
    assert list(full["accuracy"]) == list(empty["accuracy"]) == list(full["baseline_prior"])
    assert full["accuracy"]["ce_accepted"] == {"mean_m": 17.0, "median_m": 17.0, "p90_m": 27.4}
    assert empty["accuracy"]["ce_accepted"] == {"mean_m": None, "median_m": None, "p90_m": None}
    assert plain["accuracy"] is None
    assert plain["baseline_prior"] is None


def test_estimates_without_truth_are_owned_up_to() -> None:
    unlisted = replace(FIVE_ROWS[0], ce_m=math.nan, mace_m=math.nan)
    rows = report_table([column(make_run(unlisted, *FIVE_ROWS[1:]))])
    assert as_dict(rows, 1)["estimates without truth"] == "1"
    assert "estimates without truth" not in as_dict(report_table([column(make_run())]), 1)
