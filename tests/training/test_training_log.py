"""The CSV log: every step once, in order, whatever was interrupted."""

from pathlib import Path

import pandas as pd
import pytest

from uasthn_cli.errors import OutputError
from uasthn_cli.training.loop import Progress, Validation
from uasthn_cli.training.training_log import COLUMNS, TrainingLog


def progress(step: int, seconds: float = 10.0) -> Progress:
    return Progress(step, seconds, loss=3.14159, median_error_px=1.25, within_4_px=0.9375)


def test_rows_are_figures_by_name(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path / "log.csv", 0)
    log.record(progress(50, 12.34))
    log.record(progress(100, 23.45), Validation(1.5, 0.875))
    table = pd.read_csv(tmp_path / "log.csv")
    assert tuple(table.columns) == COLUMNS
    assert list(table["step"]) == [50, 100]
    assert list(table["seconds"]) == [12.3, 23.4]
    assert list(table["loss"]) == [3.1416, 3.1416]
    assert table["validation_median_error_px"].isna().tolist() == [True, False]
    assert table["validation_within_4_px"][1] == 0.875


def test_a_row_is_written_before_its_validation_and_again_with_it(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path / "log.csv", 0)
    log.record(progress(50))
    assert len(pd.read_csv(tmp_path / "log.csv")) == 1
    log.record(progress(50), Validation(1.5, 0.875))
    table = pd.read_csv(tmp_path / "log.csv")
    assert list(table["step"]) == [50]
    assert table["validation_within_4_px"][0] == 0.875


def test_a_resumed_run_appends_and_drops_what_was_never_checkpointed(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path / "log.csv", 0)
    for step in (50, 100, 150):
        log.record(progress(step, step / 10))
    resumed = TrainingLog(tmp_path / "log.csv", 100)
    resumed.record(progress(150, 5.0))
    resumed.record(progress(200, 9.0))
    table = pd.read_csv(tmp_path / "log.csv")
    assert list(table["step"]) == [50, 100, 150, 200]
    assert list(table["seconds"]) == [5.0, 10.0, 15.0, 19.0], "time of all runs together"


def test_a_new_run_starts_a_new_log(tmp_path: Path) -> None:
    TrainingLog(tmp_path / "log.csv", 0).record(progress(50))
    TrainingLog(tmp_path / "log.csv", 0).record(progress(25))
    assert list(pd.read_csv(tmp_path / "log.csv")["step"]) == [25]


def test_a_lost_log_is_begun_anew_where_the_checkpoint_stands(tmp_path: Path) -> None:
    TrainingLog(tmp_path / "log.csv", 100).record(progress(150))
    assert list(pd.read_csv(tmp_path / "log.csv")["step"]) == [150]


@pytest.mark.parametrize("content", [b"", b"a,b\n1,2\n", b"\xff\xfe", b"step\n"])
def test_a_file_that_is_no_log_is_left_alone(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(OutputError, match="not a log of training"):
        TrainingLog(path, 100)
    assert path.read_bytes() == content
