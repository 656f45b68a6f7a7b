"""Maps that cannot be used get one line that says why, and nothing of GDAL's own chatter."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import NDArray

from uasthn_cli.errors import (
    MapElsewhereError,
    MapUnreadableError,
    MapWithoutCrsError,
    UasthnError,
)
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m
from uasthn_cli.mapping.reader import MapReader, native_gsd_m
from uasthn_cli.types import GridBox

BOX = GridBox(-20, -10, 40, 24)


def noise(height_px: int, width_px: int, count: int = 3) -> NDArray[np.uint8]:
    return np.random.default_rng(2).integers(1, 255, (height_px, width_px, count), dtype=np.uint8)


def one_line(error: pytest.ExceptionInfo[UasthnError], path: Path) -> str:
    message = str(error.value)
    assert "\n" not in message
    assert str(path) in message
    return message


@pytest.mark.parametrize(
    "content", [b"", b"hello, this is a text file", bytes(range(256)) * 30, b"II*\0garbage" * 9]
)
def test_what_is_no_raster_is_refused(
    tmp_path: Path, frame: LocalFrame, content: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "map.tif"
    path.write_bytes(content)
    with pytest.raises(MapUnreadableError) as error:
        MapReader(path, frame, 2.0)
    assert "cannot open" in one_line(error, path)
    assert capfd.readouterr() == ("", "")


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path, frame: LocalFrame) -> None:
    with pytest.raises(MapUnreadableError, match="no such map"):
        MapReader(tmp_path / "nothing.tif", frame, 2.0)
    with pytest.raises(MapUnreadableError, match="cannot open"):
        native_gsd_m(tmp_path, frame)


@pytest.mark.parametrize("damage", ["truncated", "overwritten"])
def test_a_file_that_opens_but_is_damaged_is_refused_when_read(
    write_map: Any, frame: LocalFrame, capfd: pytest.CaptureFixture[str], damage: str
) -> None:
    path = write_map(noise(512, 640), tiled=True, compress="deflate")
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    if damage == "truncated":
        del content[middle:]
    else:
        content[middle : middle + 50_000] = b"\x5a" * 50_000
    path.write_bytes(content)
    with (
        pytest.raises(MapUnreadableError) as error,
        MapReader(path, frame, 2.0) as reader,
    ):
        reader.read(GridBox(-20, -10, 640, 512))
    assert "cannot read the map" in one_line(error, path)
    assert capfd.readouterr() == ("", "")


def test_a_truncated_header_is_refused(write_map: Any, frame: LocalFrame) -> None:
    path = write_map(noise(24, 40))
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(UasthnError) as error, MapReader(path, frame, 2.0) as reader:
        reader.read(BOX)
    one_line(error, path)


def test_without_a_crs_the_message_says_how_to_give_one(write_map: Any, frame: LocalFrame) -> None:
    path = write_map(noise(24, 40), crs=None)
    with pytest.raises(MapWithoutCrsError) as error:
        MapReader(path, frame, 2.0)
    assert "gdal_edit.py -a_srs" in one_line(error, path)


@pytest.mark.parametrize("crs", [None, "EPSG:32614"])
def test_without_a_transform_the_map_has_no_place(
    write_map: Any, frame: LocalFrame, crs: str | None, recwarn: pytest.WarningsRecorder
) -> None:
    path = write_map(noise(24, 40), crs=crs, transform=Affine.identity())
    recwarn.clear()
    with pytest.raises(MapWithoutCrsError) as error:
        MapReader(path, frame, 2.0)
    assert "-a_srs" in one_line(error, path)
    assert not recwarn.list


@pytest.mark.parametrize(
    ("crs", "step", "says"),
    [
        ('LOCAL_CS["site grid",UNIT["metre",1]]', 2.0, "not tied to the earth"),
        ("EPSG:4326", 2.0, "make no sense"),
        ("EPSG:32614", 1e-8, "make no sense"),
        ("EPSG:32614", 1e7, "make no sense"),
    ],
)
def test_a_crs_that_cannot_place_the_map_is_refused(
    write_map: Any, frame: LocalFrame, crs: str, step: float, says: str
) -> None:
    transform = Affine(step, 0, 420_000, 0, -step, 2_650_000)
    path = write_map(noise(24, 40), crs=crs, transform=transform)
    with pytest.raises(MapWithoutCrsError) as error:
        MapReader(path, frame, 2.0)
    assert says in one_line(error, path)


def test_a_map_elsewhere_says_where_and_how_far(write_map: Any, frame: LocalFrame) -> None:
    path = write_map(noise(24, 40))
    flight = np.array([[-35.36, 149.16], [-35.37, 149.17]])
    with MapReader(path, LocalFrame(*flight[0]), 2.0) as reader:
        with pytest.raises(MapElsewhereError) as error:
            reader.require_overlap(flight, 500.0)
        window = reader.read(BOX)
    message = one_line(error, path)
    for fact in ("47.05", "-99.2", "-35.3700 to -35.3600", "149.1600 to 149.1700"):
        assert fact in message
    distance_km = float(message.split(": ")[2].split(" km")[0])
    nearest_m = distance_m(flight, np.array([frame.lat_deg, frame.lon_deg])).min()
    assert distance_km == pytest.approx(nearest_m / 1000, abs=0.2)
    assert not window.valid.any()
    assert not window.image.any()


def test_a_flight_beside_the_map_passes_only_within_the_search_radius(
    write_map: Any, frame: LocalFrame
) -> None:
    east_edge_m = 19.5 * 2.0
    flight = frame.to_degrees(np.array([[east_edge_m + 5000.0, 0.0], [east_edge_m + 100.0, 0.0]]))
    with MapReader(write_map(noise(24, 40)), frame, 2.0) as reader:
        reader.require_overlap(flight, 101.0)
        with pytest.raises(MapElsewhereError, match=r"0\.1 km apart"):
            reader.require_overlap(flight, 99.0)
        reader.require_overlap(frame.to_degrees(np.zeros((1, 2))), 0.0)


def test_a_container_of_several_maps_is_refused(
    write_map: Any, tmp_path: Path, frame: LocalFrame
) -> None:
    path = tmp_path / "several.gpkg"
    for table in ("first", "second"):
        with rasterio.open(
            path,
            "w",
            driver="GPKG",
            dtype="uint8",
            crs="EPSG:32614",
            transform=Affine(2, 0, 420_000, 0, -2, 2_650_000),
            RASTER_TABLE=table,
            APPEND_SUBDATASET="YES" if path.exists() else "NO",
            **{"width": 40, "height": 24, "count": 3},
        ) as target:
            target.write(np.moveaxis(noise(24, 40), -1, 0))
    with pytest.raises(MapUnreadableError) as error:
        MapReader(path, frame, 2.0)
    assert "container of 2 images" in one_line(error, path)
    assert f"gdal_translate GPKG:{path}:first" in str(error.value)


def test_a_read_only_map_leaves_no_file_behind(write_map: Any, frame: LocalFrame) -> None:
    path = write_map(noise(24, 40))
    with MapReader(path, frame, 2.0) as reader:
        reader.read(BOX)
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    with rasterio.open(path) as untouched:
        assert untouched.count == 3
