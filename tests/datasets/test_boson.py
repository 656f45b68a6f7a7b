import pickle
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from pair_sources import BOSON_SIZE_PX, write_boson

from uasthn_cli.datasets.boson import BosonDataset
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.errors import DatasetError

CENTRES = {"test": [(1000, 800), (1400, 900), (2300, 850)], "val": [(1450, 950)]}
SPEC = DatasetSpec(window_m=1536, max_offset_m=256, seed=3)


def test_convention_corners_say_where_the_thermal_image_lies_in_the_satellite_image(
    tmp_path: Path,
) -> None:
    folder, _ = write_boson(tmp_path, CENTRES)
    sample = BosonDataset(folder, SPEC)[0]
    assert sample.satellite.shape == (1536, 1536, 3)
    assert sample.thermal.shape == (512, 512)
    assert sample.satellite_gsd_m == 1.0
    x, y = sample.corners_px[0]
    left, top = int(x), int(y)
    assert (left, top) == (x, y)
    seen = sample.satellite[top : top + 512, left : left + 512, 0]
    np.testing.assert_array_equal(seen, sample.thermal)
    np.testing.assert_allclose(sample.corners_px[3] - sample.corners_px[0], [511.0, 511.0])


def test_centres_lie_within_the_offset_and_differ_by_seed(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, CENTRES)
    offsets = []
    for seed in range(30):
        sample = BosonDataset(folder, DatasetSpec(window_m=600, max_offset_m=50, seed=seed))[1]
        offsets.append(sample.corners_px.mean(axis=0) - (600 - 1) / 2)
    lengths = np.linalg.norm(offsets, axis=1)
    assert lengths.max() <= 51.0
    assert lengths.max() > 25.0
    assert len({tuple(offset) for offset in np.round(offsets)}) > 20


def test_the_same_sample_each_time_and_in_another_process(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, CENTRES)
    first = BosonDataset(folder, SPEC)
    again = first[1]
    other = pickle.loads(pickle.dumps(first))[1]
    np.testing.assert_array_equal(again.satellite, other.satellite)
    np.testing.assert_array_equal(again.thermal, other.thermal)
    np.testing.assert_array_equal(again.corners_px, other.corners_px)


def test_names_with_the_row_first_are_noticed(tmp_path: Path) -> None:
    width_px, height_px = BOSON_SIZE_PX
    assert width_px > height_px
    plain, _ = write_boson(tmp_path / "plain", CENTRES)
    swapped, _ = write_boson(tmp_path / "swapped", CENTRES, name="@{y}@{x}@")
    expected, found = BosonDataset(plain, SPEC)[2], BosonDataset(swapped, SPEC)[2]
    np.testing.assert_array_equal(found.corners_px, expected.corners_px)


def test_a_world_file_places_the_map(tmp_path: Path) -> None:
    east_m, north_m = 420_000.0, 2_650_000.0
    folder, _ = write_boson(tmp_path / "world", CENTRES)
    plain, _ = write_boson(tmp_path / "plain", CENTRES)
    world = tmp_path / "world" / "maps" / "satellite" / "20201117_BingSatellite.pgw"
    world.write_text(f"1\n0\n0\n-1\n{east_m + 0.5}\n{north_m - 0.5}\n")
    with h5py.File(folder / "test_queries.h5", "r+") as opened:
        del opened["image_name"]
        opened["image_name"] = [f"a@{east_m + x}@{north_m - y}@b.png" for x, y in CENTRES["test"]]
    expected, found = BosonDataset(plain, SPEC)[0], BosonDataset(folder, SPEC)[0]
    np.testing.assert_array_equal(found.corners_px, expected.corners_px)
    np.testing.assert_array_equal(found.satellite, expected.satellite)


def test_images_that_see_the_validation_region_can_be_left_out(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, CENTRES)
    kept = BosonDataset(folder, DatasetSpec(window_m=600, exclude_validation=True))
    assert [kept[index].name for index in range(len(kept))] == ["@2300@850@"]


def test_colour_queries_and_beyond_the_map(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, CENTRES, channels=3)
    sample = BosonDataset(folder, SPEC)[2]
    assert sample.thermal.shape == (512, 512)
    assert not sample.satellite[:, -1].any()


def test_fewer_samples_are_spread_over_the_split(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, CENTRES)
    two = BosonDataset(folder, DatasetSpec(window_m=600, samples=2))
    assert [two[0].name, two[1].name] == ["@1000@800@", "@2300@850@"]
    with pytest.raises(IndexError):
        two[2]


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, CENTRES)
    with pytest.raises(DatasetError, match=r"extended_queries\.h5 does not exist"):
        BosonDataset(folder, DatasetSpec(split="extended"))
    with h5py.File(folder / "train_queries.h5", "w") as opened:
        opened["image_data"] = np.zeros((1, 4, 4), np.uint8)
    with pytest.raises(DatasetError, match="has no image_name, image_size"):
        BosonDataset(folder, DatasetSpec(split="train"))
    (folder / "train_queries.h5").write_bytes(b"no")
    with pytest.raises(DatasetError, match="no whole HDF5 file"):
        BosonDataset(folder, DatasetSpec(split="train"))
    for path in (tmp_path / "maps" / "satellite").iterdir():
        path.unlink()
    with pytest.raises(DatasetError, match="no satellite map"):
        BosonDataset(folder, SPEC)


def test_a_map_of_another_place_and_maps_of_two_sizes_are_refused(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, CENTRES)
    maps = tmp_path / "maps" / "satellite"
    cv2.imwrite(str(maps / "small.png"), np.zeros((40, 50), np.uint8))
    with pytest.raises(DatasetError, match="differ in size"):
        BosonDataset(folder, SPEC)
    (maps / "20201117_BingSatellite.png").unlink()
    with pytest.raises(DatasetError, match=r"no image lies on small\.png"):
        BosonDataset(folder, SPEC)
    (maps / "small.png").write_bytes(b"GIF89a and what follows in such files")
    with pytest.raises(DatasetError, match="is no PNG"):
        BosonDataset(folder, SPEC)


def test_names_without_a_place_are_refused(tmp_path: Path) -> None:
    folder, _ = write_boson(tmp_path, {"test": [(900, 900)]}, name="frame_{x}_{y}")
    with pytest.raises(DatasetError, match=r"holds no @easting@northing@"):
        BosonDataset(folder, SPEC)
