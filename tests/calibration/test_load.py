import math
from pathlib import Path

import numpy as np
import pytest
from answer_tables import FIRST_FRAME_UTC_S, answer_cells, make_answers, write_results, write_rows

from uasthn_cli.calibration.answers import Answers
from uasthn_cli.calibration.load import GpsStretch, load_answers
from uasthn_cli.errors import CalibrationError, ResultsError
from uasthn_cli.uncertainty.calibration import AnswerKind


def test_a_run_of_single_frames(tmp_path: Path) -> None:
    written = make_answers(20, 1)
    runs = load_answers([write_results(tmp_path / "a", written)])
    assert runs.fused is None
    np.testing.assert_allclose(runs.single.error_m, written.error_m, atol=1e-4)
    np.testing.assert_allclose(runs.single.ce90_m, written.ce90_m, atol=1e-4)
    for name, values in written.signals.items():
        np.testing.assert_allclose(runs.single.signals[name], values, atol=1e-4)
    assert runs.single.acceptable.all()


def test_a_fused_run_beside_one_that_is_not(tmp_path: Path) -> None:
    fused, single = make_answers(20, 1, agreement=True), make_answers(20, 2)
    first = write_results(tmp_path / "a", fused, single)
    second = write_results(tmp_path / "b", make_answers(10, 3))
    runs = load_answers([first, second])
    assert runs.fused is not None
    np.testing.assert_allclose(runs.fused.error_m, fused.error_m, atol=1e-4)
    np.testing.assert_allclose(runs.single.error_m[:20], single.error_m, atol=1e-4)
    assert runs.single.flight.tolist() == [0] * 20 + [1] * 10
    assert np.isnan(runs.single.signals["agreement_m"]).all()
    assert np.isnan(runs.single.signals["support"]).all()


def rows_of(answers: Answers) -> list[dict[str, str]]:
    common = {"lat": "24.0", "lon": "56.0", "prior_lat": "24.1", "prior_lon": "56.1"}
    return [
        {"frame": f"{k}.png", "time_utc": "", "source": "fix", "mace_m": "0", **common, **cells}
        for k, cells in enumerate(answer_cells(answers))
    ]


def test_who_takes_part(tmp_path: Path) -> None:
    rows = rows_of(make_answers(5, 1))
    rows[1]["reason"] = "implausible-scale"
    rows[2] |= {"lat": "", "lon": "", "center_lat": "", "ce_m": "", "reason": "textureless"}
    rows[3]["ce_m"] = ""  # an answer that no truth judges
    rows[4]["source"] = "prior"
    write_rows(tmp_path / "a", rows)
    single = load_answers([tmp_path / "a"]).single
    assert len(single) == 4
    assert single.acceptable.tolist() == [True, False, False, False]
    assert np.isfinite(single.error_m).tolist() == [True, True, False, False]


def test_a_frame_whose_main_answer_is_its_own_is_not_fused(tmp_path: Path) -> None:
    rows = rows_of(make_answers(3, 1))
    single = answer_cells(make_answers(3, 2), "single_")
    whole = [row | own for row, own in zip(rows, single, strict=True)]
    whole[0]["source"] = "fused"
    write_rows(tmp_path / "a", whole)
    runs = load_answers([tmp_path / "a"])
    assert runs.fused is not None
    assert (len(runs.fused), len(runs.single)) == (1, 3)


def test_absent_signals_are_empty_signals(tmp_path: Path) -> None:
    rows = rows_of(make_answers(3, 1))
    for row in rows:
        del row["entropy"], row["ce90_m"]
    write_rows(tmp_path / "a", rows)
    single = load_answers([tmp_path / "a"]).single
    assert np.isnan(single.signals["entropy"]).all()
    assert np.isnan(single.ce90_m).all()


def test_a_scale_that_the_run_applied_is_taken_out_again(tmp_path: Path) -> None:
    answers = make_answers(4, 1)
    record = {"calibration": {"single": {"ce90_scale": 2.0}, "fused": None}}
    folder = write_results(tmp_path / "a", answers, record=record)
    np.testing.assert_allclose(load_answers([folder]).single.ce90_m, answers.ce90_m / 2, atol=1e-4)


@pytest.mark.parametrize(
    ("stretch", "expected"),
    [
        (GpsStretch(), 10),
        (GpsStretch(FIRST_FRAME_UTC_S + 2, FIRST_FRAME_UTC_S + 5), 4),
        (GpsStretch(end_utc_s=FIRST_FRAME_UTC_S + 2.5), 3),
    ],
)
def test_a_stretch_of_good_gps(tmp_path: Path, stretch: GpsStretch, expected: int) -> None:
    folder = write_results(tmp_path / "a", make_answers(10, 1))
    assert len(load_answers([folder], stretch).single) == expected


def test_with_gps_errors_are_offsets_from_the_log(tmp_path: Path) -> None:
    rows = rows_of(make_answers(2, 1))
    for row in rows:
        row["offset_m"] = "7.5"
        del row["ce_m"], row["mace_m"]
    write_rows(tmp_path / "a", rows)
    assert load_answers([tmp_path / "a"], GpsStretch()).single.error_m.tolist() == [7.5, 7.5]
    with pytest.raises(CalibrationError, match=r"no column ce_m: run .* --truth"):
        load_answers([tmp_path / "a"])


def test_no_frame_in_the_stretch(tmp_path: Path) -> None:
    folder = write_results(tmp_path / "a", make_answers(3, 1))
    with pytest.raises(CalibrationError, match="no frame in the stretch"):
        load_answers([folder], GpsStretch(0.0, 1.0))


def test_bad_cells_are_named_by_their_line(tmp_path: Path) -> None:
    rows = rows_of(make_answers(4, 1))
    rows[2]["entropy"] = "much"
    write_rows(tmp_path / "a", rows)
    with pytest.raises(ResultsError, match=r"frames.csv:4: entropy is 'much', expected a number"):
        load_answers([tmp_path / "a"])


@pytest.mark.parametrize("scale", [0, "2", math.inf])
def test_a_bad_scale_in_the_record(tmp_path: Path, scale: object) -> None:
    record = {"calibration": {"single": {"ce90_scale": scale}}}
    folder = write_results(tmp_path / "a", make_answers(3, 1), record=record)
    with pytest.raises(ResultsError, match=r"run.json: calibration: single: ce90_scale is"):
        load_answers([folder])


def test_a_folder_given_twice(tmp_path: Path) -> None:
    folder = write_results(tmp_path / "a", make_answers(3, 1))
    with pytest.raises(ResultsError, match="given twice"):
        load_answers([folder, folder / ".." / "a"])


def record_of(estimator: str, method: str) -> dict[str, object]:
    return {"notes": {"estimator": estimator, "uncertainty": {"method": method}}}


def test_runs_say_whose_answers_they_hold(tmp_path: Path) -> None:
    first = write_results(tmp_path / "a", make_answers(3, 1), record=record_of("ihn", "de"))
    second = write_results(tmp_path / "b", make_answers(3, 2), record=record_of("ihn", "de"))
    assert load_answers([first, second]).kind == AnswerKind("ihn", "de")
    assert load_answers([write_results(tmp_path / "old", make_answers(3, 1))]).kind is None


@pytest.mark.parametrize("other", [record_of("ihn", "croptta"), record_of("dhn", "de"), {}])
def test_answers_of_two_kinds_are_not_calibrated_together(
    tmp_path: Path, other: dict[str, object]
) -> None:
    first = write_results(tmp_path / "a", make_answers(3, 1), record=record_of("ihn", "de"))
    second = write_results(tmp_path / "b", make_answers(3, 2), record=other)
    with pytest.raises(CalibrationError, match=r"b: its answers are of .* one kind at a time"):
        load_answers([first, second])
