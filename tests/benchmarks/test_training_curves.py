"""Curves of training are read from logs as they lie beside weights."""

from pathlib import Path

import click
import pytest
from training_curves import read_curve

LOG = """step,seconds,loss,median_error_px,validation_median_error_px
20,60.0,3.0,50.0,
40,120.0,2.0,5.0,6.5
"""


def test_a_log_becomes_a_row(tmp_path: Path) -> None:
    path = tmp_path / "a.log.csv"
    path.write_text(LOG, encoding="utf-8")
    assert read_curve(f"net={path}:4").row() == ["net", "40", "160", "2.0", "50.0", "5.0", "6.5"]


@pytest.mark.parametrize("content", ["", "step,seconds\n1,2\n"])
def test_another_file_is_no_log(tmp_path: Path, content: str) -> None:
    path = tmp_path / "a.log.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(click.BadParameter, match="net="):
        read_curve(f"net={path}")
