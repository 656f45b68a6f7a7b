import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_flight import DRIFT_M, HFOV_DEG, make_flight

from uasthn_cli.datasets import flights
from uasthn_cli.datasets.flights import FlightDataset
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.errors import CameraError, DatasetError
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.ingest.frames import read_frame
from uasthn_cli.types import ImageArray

CAMERA = CameraSpec(hfov_deg=HFOV_DEG)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_flight(tmp_path_factory.mktemp("flight")).map.parent


def test_convention_the_map_between_the_corners_is_what_the_frame_shows(folder: Path) -> None:
    data = FlightDataset(folder, DatasetSpec(max_offset_m=20.0, camera=CAMERA))
    assert len(data) == 4
    for index in range(4):
        sample = data[index]
        side_px = len(sample.thermal)
        H = homography_from_corners(image_corners_px(side_px, side_px), sample.corners_px)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size_px = (side_px, side_px)
        seen = cv2.warpPerspective(sample.satellite[..., 0], H, size_px, flags=flags)
        assert (
            np.corrcoef(seen.ravel(), sample.thermal.ravel())[0, 1] < -0.97
        )  # frames are negatives of the map


def test_windows_are_centred_where_the_log_has_the_frame_if_no_offset_is_given(
    folder: Path,
) -> None:
    sample = FlightDataset(folder, DatasetSpec(window_m=150.0, camera=CAMERA))[1]
    middle_px = (len(sample.satellite) - 1) / 2
    offset_m = (sample.corners_px.mean(axis=0) - middle_px) * sample.satellite_gsd_m
    np.testing.assert_allclose(offset_m, [-DRIFT_M, 0.0], atol=1.0)


def test_windows_are_centred_within_the_offset_and_just_hold_the_search(folder: Path) -> None:
    spec = DatasetSpec(max_offset_m=20.0, camera=CAMERA, thermal_m=40.0)
    data = FlightDataset(folder, spec)
    offsets = []
    for index in range(4):
        sample = data[index]
        assert len(sample.thermal) * sample.satellite_gsd_m <= 40.0 + 1.0
        expected_m = len(sample.thermal) * sample.satellite_gsd_m + 40.0
        assert len(sample.satellite) * sample.satellite_gsd_m == pytest.approx(expected_m, abs=1)
        middle_px = (len(sample.satellite) - 1) / 2
        offsets.append((sample.corners_px.mean(axis=0) - middle_px) * sample.satellite_gsd_m)
    assert np.linalg.norm(offsets, axis=1).max() <= 21.0
    assert len({tuple(offset) for offset in offsets}) == 4


def test_the_same_sample_in_another_process(folder: Path) -> None:
    data = FlightDataset(folder, DatasetSpec(max_offset_m=20.0, camera=CAMERA, samples=2))
    assert len(data) == 2
    first, again = data[1], pickle.loads(pickle.dumps(data))[1]
    assert first.name == again.name
    np.testing.assert_array_equal(first.satellite, again.satellite)
    np.testing.assert_array_equal(first.corners_px, again.corners_px)


def test_frames_that_show_too_little_and_frames_without_truth(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no frame shows a square of 24 px"):
        FlightDataset(folder, DatasetSpec(gsd_m=6.0, camera=CAMERA))
    copy = tmp_path / "flight"
    shutil.copytree(folder, copy)
    truth = copy / "truth.csv"
    header, first, *_ = truth.read_text().splitlines()
    truth.write_text(f"{header}\n{first}\n")
    assert len(FlightDataset(copy, DatasetSpec(camera=CAMERA))) == 1
    truth.write_text(f"{header}\n{first.replace('.png', '.jpg')}\n")
    with pytest.raises(DatasetError, match="no frame has a place both in the log and in truth"):
        FlightDataset(copy, DatasetSpec(camera=CAMERA))


def test_without_a_focal_length_the_camera_is_asked_for(folder: Path) -> None:
    with pytest.raises(CameraError, match="--hfov"):
        FlightDataset(folder, DatasetSpec(max_offset_m=20.0))


def test_a_first_frame_that_cannot_be_read_leaves_the_others(folder: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "copy")
    first, *others = sorted((copy / "frames").iterdir())
    first.write_bytes(b"no picture")
    spec = DatasetSpec(max_offset_m=20.0, camera=CAMERA)
    assert len(FlightDataset(copy, spec)) == 3
    for path in others:
        path.write_bytes(b"no picture")
    with pytest.raises(DatasetError, match="no frame can be read"):
        FlightDataset(copy, spec)


@pytest.fixture(scope="module")
def longer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_flight(tmp_path_factory.mktemp("longer"), 7).map.parent


def names(data: FlightDataset) -> list[str]:
    return [data[index].name for index in range(len(data))]


@pytest.mark.parametrize(("samples", "places"), [(1, [0]), (3, [0, 3, 6]), (9, range(7))])
def test_only_the_frames_that_are_used_are_looked_at(
    samples: int, places: list[int], longer: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def read_noted(path: Path) -> ImageArray:
        seen.append(path.name)
        return read_frame(path)

    monkeypatch.setattr(flights, "read_frame", read_noted)
    spec = DatasetSpec(max_offset_m=20.0, camera=CAMERA, samples=samples)
    data = FlightDataset(longer, spec)
    every = sorted(path.name for path in (longer / "frames").iterdir())
    assert seen == [every[place] for place in places]
    assert names(data) == [every[place] for place in places]


def test_a_broken_frame_is_said_and_leaves_its_place_to_the_nearest(
    longer: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    copy = shutil.copytree(longer, tmp_path / "copy")
    every = sorted((copy / "frames").iterdir())
    for place in (0, 3, 4):
        every[place].write_bytes(b"no picture")
    spec = DatasetSpec(max_offset_m=20.0, camera=CAMERA, samples=3)
    assert names(FlightDataset(copy, spec)) == [every[place].name for place in (1, 2, 6)]
    assert f"{every[3].name} is skipped: not a PNG, JPEG or TIFF image" in caplog.messages
    assert len(FlightDataset(copy, replace(spec, samples=6))) == 4
