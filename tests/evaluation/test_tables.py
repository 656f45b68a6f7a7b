import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from known_estimator import SETTINGS, made_up_predictions

from uasthn_cli.config import DecisionConfig, UeMethod
from uasthn_cli.evaluation.judging import JudgingConfig
from uasthn_cli.evaluation.tables import (
    accuracy_csv,
    accuracy_rows,
    accuracy_table,
    evaluation_json,
    run_names,
    timing_csv,
    timing_rows,
    timing_table,
)

ERRORS_M, STD_M = np.array([4.0, 8.0, 60.0, 100.0]), np.array([1.0, 5.0, 8.0, 30.0])
CONFIG = JudgingConfig(DecisionConfig(max_std_m=10.0))
ALL = tuple(UeMethod)


def test_table_one_has_a_row_for_every_run_and_method_that_it_allows() -> None:
    runs = [
        made_up_predictions(ERRORS_M, STD_M, members=3, max_offset_m=128.0),
        made_up_predictions(ERRORS_M, STD_M, max_offset_m=512.0),
    ]
    rows = accuracy_rows(runs, ALL, CONFIG)
    assert [(row.max_offset_m, row.ue) for row in rows] == [
        (128.0, "none"),
        (128.0, "de"),
        (128.0, "croptta"),
        (128.0, "croptta+de"),
        (512.0, "none"),
        (512.0, "croptta"),
    ]
    header, *lines = accuracy_table(rows, 25.0)
    assert "of these ≤ 25 m" in header
    assert lines[2] == ["known", "croptta", "128", "4", "24.00", "24.00", "0.750", "0.667", "1.000"]
    assert lines[0][-1] == "-"


def test_table_two_adds_up_what_each_method_needs() -> None:
    (row,) = timing_rows([made_up_predictions(ERRORS_M, STD_M, members=3)])
    times = (row.none_ms, row.croptta_ms, row.de_ms, row.croptta_de_ms)
    assert times == pytest.approx((100.0, 200.0, 400.0, 500.0))
    (lone,) = timing_rows([made_up_predictions(ERRORS_M, STD_M, views=1, ue_iterations=2)])
    assert (lone.croptta_ms, lone.de_ms, lone.croptta_de_ms) == (None, None, None)
    _, line = timing_table([lone])
    assert line == ["known", "128", "after 2", "100.0", "-", "-", "-"]


def test_times_are_medians_of_what_was_measured() -> None:
    some = made_up_predictions(ERRORS_M, STD_M)
    some.seconds[:, 0] = [np.nan, 0.1, 0.9, 0.2]
    (row,) = timing_rows([some])
    assert row.none_ms == pytest.approx(200.0)


def test_runs_are_named_by_what_tells_them_apart() -> None:
    runs = [SETTINGS, replace(SETTINGS, views=3), replace(SETTINGS, weights=("a@1", "b@2"))]
    assert run_names(runs[:1]) == ["known"]
    assert run_names(runs) == [
        "known, weights -, views 5",
        "known, weights -, views 3",
        "known, weights a@1+b@2, views 5",
    ]


def test_runs_that_nothing_tells_apart_are_numbered() -> None:
    assert run_names([SETTINGS, SETTINGS]) == ["known", "known #2"]
    # one per D_C is told apart by its column
    assert run_names([SETTINGS, replace(SETTINGS, max_offset_m=512.0)]) == ["known", "known"]


def test_csv_and_json_hold_the_same() -> None:
    runs = [made_up_predictions(ERRORS_M, STD_M)]
    accuracy, timing = accuracy_rows(runs, ALL, CONFIG), timing_rows(runs)
    content = json.loads(evaluation_json(accuracy, timing, runs))
    read = list(csv.DictReader(io.StringIO(accuracy_csv(accuracy))))
    assert len(read) == len(content["accuracy"]) == 2
    for line, row in zip(read, content["accuracy"], strict=True):
        assert line == {key: "" if value is None else str(value) for key, value in row.items()}
    (times,) = csv.DictReader(io.StringIO(timing_csv(timing)))
    assert float(times["croptta_ms"]) == pytest.approx(content["timing"][0]["croptta_ms"])
    assert times["de_ms"] == ""
    assert content["runs"][0]["offset_fraction"] == 1 / 16
