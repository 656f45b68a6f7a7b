"""Windows that are cut about one pair still know where the pair's middle is."""

from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
import shifted_pairs
from click.testing import CliRunner

from uasthn_cli.datasets.opening import open_dataset
from uasthn_cli.datasets.spec import DatasetSpec


def test_windows_say_where_the_middle_lies(tmp_path: Path) -> None:
    satellite = np.zeros((201, 201, 3), np.uint8)
    satellite[100, 100] = 255  # what both images have in their middles
    thermal = np.full((64, 64), 90, np.uint8)
    for name, image in (("satellite", satellite), ("thermal", thermal)):
        assert cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    arguments = [str(tmp_path / "satellite.png"), str(tmp_path / "thermal.png")]
    arguments += ["--satellite-gsd", "4", "--thermal-gsd", "2", "--dc", "100", "--count", "8"]
    out = tmp_path / "pairs"
    result = CliRunner().invoke(shifted_pairs.main, [*arguments, "--out", str(out)])
    assert result.exit_code == 0, result.output
    table = pd.read_csv(out / "pairs.csv", dtype={"name": str})
    offsets_px = []
    for row in table.itertuples():
        window = cv2.imread(str(out / str(row.satellite)), cv2.IMREAD_GRAYSCALE)
        assert window is not None
        y, x = np.unravel_index(int(window.argmax()), window.shape)
        assert (x, y) == (row.center_x, row.center_y)
        offsets_px.append(np.hypot(x - (window.shape[1] - 1) / 2, y - (window.shape[0] - 1) / 2))
    assert 5.0 < max(offsets_px) <= 100 / 4 + 1.0
    assert len(open_dataset(str(out), DatasetSpec())) == len(table)


def test_a_window_too_small_for_the_frame_is_refused(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "a.png"), np.zeros((100, 100), np.uint8))
    arguments = [str(tmp_path / "a.png"), str(tmp_path / "a.png"), "--satellite-gsd", "4"]
    arguments += ["--thermal-gsd", "2", "--dc", "190", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(shifted_pairs.main, arguments)
    assert result.exit_code == 2
    assert "--dc 190" in result.output


@pytest.mark.parametrize("seed", [0, 1])
def test_offsets_fill_a_disc_evenly(seed: int) -> None:
    distance_px = np.linalg.norm(shifted_pairs.offsets_px(4000, 10.0, seed), axis=1)
    assert distance_px.max() <= 10.0
    assert np.mean(distance_px < 5.0) == pytest.approx(0.25, abs=0.03)
