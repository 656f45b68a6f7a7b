import copy
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from pair_sources import texture, write_geotiff

from uasthn_cli.datasets.overhead import open_sites
from uasthn_cli.datasets.rendered import RenderedDataset
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.errors import DatasetError
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px
from uasthn_cli.training.engine import PARTS, engine_without

SPEC = DatasetSpec(window_m=600.0, thermal_m=200.0, max_offset_m=128.0, samples=6, seed=2)


def dataset(path: Path, spec: DatasetSpec = SPEC) -> RenderedDataset:
    return RenderedDataset(open_sites([path], spec.gsd_m), spec)


def test_sizes_offsets_and_metres(tmp_path: Path) -> None:
    data = dataset(write_geotiff(tmp_path / "map.tif", texture(1, 500, 420), 2.5))
    assert len(data) == 6
    for index in range(6):
        sample = data[index]
        assert sample.satellite.shape == (240, 240, 3)
        assert sample.thermal.shape == (80, 80)
        assert sample.satellite_gsd_m == pytest.approx(2.5, rel=2e-3)
        offset_px = sample.corners_px.mean(axis=0) - 239 / 2
        assert np.linalg.norm(offset_px) * 2.5 <= 128.0 * 1.002


def test_convention_the_thermal_image_lies_where_the_corners_say(tmp_path: Path) -> None:
    spec = DatasetSpec(
        window_m=600, thermal_m=200, max_offset_m=128, samples=8, yaw_error_deg=8, scale_error=0.1
    )
    path = write_geotiff(tmp_path / "map.tif", texture(1, 500, 420), 2.5)
    plain = RenderedDataset(open_sites([path], None), spec, engine_without(PARTS))
    for index in range(8):
        sample = plain[index]
        H = homography_from_corners(image_corners_px(80, 80), sample.corners_px)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(sample.satellite[..., 0], H, (80, 80), flags=flags)
        correlation = np.corrcoef(seen.ravel(), sample.thermal.ravel())[0, 1]
        assert abs(correlation) > 0.98


def test_a_copy_opens_files_of_its_own(tmp_path: Path) -> None:
    data = dataset(write_geotiff(tmp_path / "map.tif", texture(1, 500, 420), 2.5))
    _ = data[0]
    (site,), (other,) = data._sites, copy.copy(data)._sites
    assert "_readers" in vars(site)
    assert "_readers" not in vars(other)


def test_samples_depend_on_seed_and_index_alone(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "map.tif", texture(1, 500, 420), 2.5)
    data = dataset(path)
    late = data[4]
    again = pickle.loads(pickle.dumps(data))[4]
    np.testing.assert_array_equal(late.thermal, again.thermal)
    np.testing.assert_array_equal(late.satellite, again.satellite)
    np.testing.assert_array_equal(copy.copy(data)[4].satellite, late.satellite)
    other = dataset(path, DatasetSpec(600.0, 200.0, 128.0, samples=6, seed=3))[4]
    assert not np.array_equal(late.corners_px, other.corners_px)


def test_maps_of_one_place_are_dates(tmp_path: Path) -> None:
    paths = [
        write_geotiff(tmp_path / f"{year}.tif", texture(year, 300, 300), 2.5) for year in (1, 2)
    ]
    elsewhere = write_geotiff(tmp_path / "far.tif", texture(3, 300, 300), 2.5, west_m=560_000.0)
    sites = open_sites([*paths, elsewhere], None)
    assert [site.dates for site in sites] == [2, 1]


def test_a_picture_needs_its_metres_a_pixel(tmp_path: Path) -> None:
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), texture(1, 400, 300))
    with pytest.raises(DatasetError, match=r"photo\.png does not say where it lies.*--gsd"):
        open_sites([path], None)
    spec = DatasetSpec(window_m=500, thermal_m=150, max_offset_m=50, gsd_m=2.0, samples=1)
    sample = dataset(path, spec)[0]
    assert sample.satellite.shape == (250, 250, 3)
    assert sample.satellite_gsd_m == 2.0


def test_too_small_a_map_is_refused(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "map.tif", texture(1, 200, 200), 2.5)
    with pytest.raises(DatasetError, match="none of 1 places is 600 m wide"):
        dataset(path)


def test_a_map_without_data_is_refused(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "map.tif", texture(1, 500, 420), 2.5)
    data = dataset(path, DatasetSpec(600.0, 200.0, 50_000.0, samples=1))
    with pytest.raises(DatasetError, match="no window of 600 m found"):
        data[0]
