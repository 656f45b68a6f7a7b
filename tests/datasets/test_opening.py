import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from pair_sources import texture, write_boson, write_geotiff
from small_flight import HFOV_DEG, make_flight

from uasthn_cli.datasets.boson import BosonDataset
from uasthn_cli.datasets.flights import FlightDataset
from uasthn_cli.datasets.opening import open_dataset
from uasthn_cli.datasets.pairs import PairsDataset
from uasthn_cli.datasets.rendered import RenderedDataset
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.errors import DatasetError
from uasthn_cli.ingest.cameras import CameraSpec

SPEC = DatasetSpec(window_m=400, thermal_m=150, samples=1, camera=CameraSpec(hfov_deg=HFOV_DEG))


def test_sources_are_told_apart_by_what_is_there(tmp_path: Path) -> None:
    make_flight(tmp_path / "flight", 1)
    assert isinstance(open_dataset(str(tmp_path / "flight"), SPEC), FlightDataset)
    boson, _ = write_boson(tmp_path / "boson", {"test": [(900, 900)]})
    assert isinstance(open_dataset(str(boson), SPEC), BosonDataset)
    maps = tmp_path / "images"
    maps.mkdir()
    write_geotiff(maps / "a.tif", texture(1, 200, 200), 2.5)
    for source in (maps, maps / "a.tif", maps / "*.tif"):
        assert isinstance(open_dataset(str(source), SPEC), RenderedDataset)
    pairs = tmp_path / "pairs"
    pairs.mkdir()
    cv2.imwrite(str(pairs / "a.png"), texture(1, 60, 60))
    header = "name,satellite,thermal,satellite_gsd_m,center_x,center_y,thermal_gsd_m"
    (pairs / "all.csv").write_text(f"{header}\na,a.png,a.png,1,29.5,29.5,1\n")
    for source in (pairs, pairs / "all.csv"):
        assert isinstance(open_dataset(str(source), SPEC), PairsDataset)


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such file or folder; expected a flight"):
        open_dataset(str(tmp_path / "nothing"), SPEC)
    with pytest.raises(DatasetError, match="is no data set: expected"):
        open_dataset(str(tmp_path), SPEC)
    flight = make_flight(tmp_path / "flight", 1)
    flight.truth.unlink()
    flight.map.rename(tmp_path / "elsewhere.tif")
    with pytest.raises(DatasetError, match=r"of a flight, map\.tif, truth\.csv is missing"):
        open_dataset(str(tmp_path / "flight"), SPEC)


def test_other_sources_do_without_h5py() -> None:
    code = "import sys, uasthn_cli.datasets.opening; sys.exit('h5py' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
