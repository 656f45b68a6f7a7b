from pathlib import Path

import cv2
import numpy as np
import pytest
from pair_sources import texture

from uasthn_cli.datasets.pairs import PairsDataset
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.errors import DatasetError

HEADER = "name,satellite,thermal,satellite_gsd_m,center_x,center_y,thermal_gsd_m\n"


def write_pair(folder: Path) -> None:
    ground = texture(2, 300, 260)
    cv2.imwrite(str(folder / "map.png"), np.repeat(ground[..., None], 3, axis=2))
    cv2.imwrite(str(folder / "night.png"), ground[100:160, 120:200])


def table(folder: Path, text: str) -> Path:
    path = folder / "pairs.csv"
    path.write_text(text)
    return path


def test_convention_corners_follow_the_squares_that_are_cut(tmp_path: Path) -> None:
    write_pair(tmp_path)
    centre = "159.5,129.5"
    path = table(tmp_path, f"{HEADER}a,map.png,night.png,2.0,{centre},2.0\n")
    sample = PairsDataset(path, DatasetSpec())[0]
    assert sample.satellite.shape == (260, 260, 3)
    assert sample.thermal.shape == (60, 60)
    x, y = (round(value) for value in sample.corners_px[0])
    np.testing.assert_allclose(sample.corners_px[0], [110.0, 100.0])
    seen = sample.satellite[y : y + 60, x : x + 60, 0]
    np.testing.assert_array_equal(seen, sample.thermal)


def test_the_coarser_image_is_enlarged(tmp_path: Path) -> None:
    write_pair(tmp_path)
    fine = cv2.resize(texture(2, 300, 260)[100:160, 120:200], (240, 180))
    cv2.imwrite(str(tmp_path / "fine.png"), fine)
    path = table(tmp_path, f"{HEADER}a,map.png,fine.png,3.0,159.5,129.5,1.0\n")
    sample = PairsDataset(path, DatasetSpec())[0]
    assert sample.satellite_gsd_m == pytest.approx(1.0)
    assert sample.thermal.shape == (180, 180)
    assert sample.satellite.shape == (780, 780, 3)
    # edges stay: pixel 110 of the cut map begins at its 330th pixel of a third of the size
    np.testing.assert_allclose(sample.corners_px[0], [330.0, 300.0])


def test_corners_are_taken_as_they_are(tmp_path: Path) -> None:
    write_pair(tmp_path)
    columns = "tl_x,tl_y,tr_x,tr_y,bl_x,bl_y,br_x,br_y"
    corners = "120,100,199,100,120,159,199,159"
    path = table(
        tmp_path,
        f"name,satellite,thermal,satellite_gsd_m,{columns}\na,map.png,night.png,2,{corners}\n",
    )
    sample = PairsDataset(path, DatasetSpec())[0]
    np.testing.assert_allclose(
        sample.corners_px, [[110, 100], [169, 100], [110, 159], [169, 159]], atol=1e-9
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,thermal\n", "column satellite, satellite_gsd_m is missing"),
        (HEADER, "has no rows"),
        (f"{HEADER}a,map.png,night.png,2,,,\n", "give the corners"),
        (f"{HEADER}a,map.png,night.png,2,5,x,1\n", "center_y is 'x', expected a number"),
        (f"{HEADER}a,map.png,night.png,0,5,5,1\n", "satellite_gsd_m is 0"),
    ],
)
def test_wrong_tables(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        PairsDataset(table(tmp_path, text), DatasetSpec())


def test_a_missing_image_is_named(tmp_path: Path) -> None:
    path = table(tmp_path, f"{HEADER}a,map.png,night.png,2,5,5,1\n")
    with pytest.raises(DatasetError, match=r"map\.png is no readable image"):
        PairsDataset(path, DatasetSpec())[0]
