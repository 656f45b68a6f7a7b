"""Pairs of images from a folder and a CSV table; the images themselves are not touched.

Columns: ``name``, ``satellite``, ``thermal`` (paths relative to the table), ``satellite_gsd_m``,
and where the thermal image truly lies in pixels of the satellite image: its corner pixels ``tl_x``,
``tl_y``, ``tr_x`` … ``br_y``, or for an upright one its middle ``center_x``, ``center_y`` with
``thermal_gsd_m``. Others are ignored. The middle of the satellite image is what a prior would say.
"""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.datasets.windows import cut_square, image_u8
from uasthn_cli.errors import DatasetError
from uasthn_cli.geometry.corners import (
    area_px,
    homography_from_corners,
    image_corners_px,
    transform_points,
)
from uasthn_cli.geometry.pixels import resize_homography
from uasthn_cli.types import FloatArray

NAMED: Final = ("name", "satellite", "thermal", "satellite_gsd_m")
CORNERS: Final = tuple(f"{corner}_{axis}" for corner in ("tl", "tr", "bl", "br") for axis in "xy")
CENTRED: Final = ("center_x", "center_y", "thermal_gsd_m")


@dataclass(frozen=True, slots=True)
class _Row:
    """One line of the table; either ``corners_px`` ``(4, 2)`` or centre and GSD are known."""

    name: str
    satellite: Path
    thermal: Path
    satellite_gsd_m: float
    corners_px: FloatArray | None
    centre_px: FloatArray | None
    thermal_gsd_m: float | None


class PairsDataset:
    """The pairs of one table, both images at the finer one's metres a pixel."""

    def __init__(self, table: Path, spec: DatasetSpec) -> None:
        """Read the table.

        Raises:
            DatasetError: it cannot be read, lacks a column or holds no number where one is needed.
        """
        rows = _read_table(table)
        self._rows = rows if spec.samples is None else rows[: spec.samples]

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self._rows)

    def __getitem__(self, index: int) -> MatchSample:
        """Read a pair: squares about the middles of both images.

        Raises:
            IndexError: there are not so many.
            DatasetError: an image cannot be read.
        """
        if not 0 <= index < len(self):
            raise IndexError(index)
        row = self._rows[index]
        satellite = _read(row.satellite, cv2.IMREAD_COLOR_RGB)
        thermal = _read(row.thermal, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
        satellite, start_px = _middle_square(satellite)
        H_thermal_satellite = homography_from_corners(
            image_corners_px(thermal.shape[1], thermal.shape[0]),
            _corners_px(row, thermal) - start_px,
        )
        square, first_px = _middle_square(thermal)
        corners_px = image_corners_px(square.shape[0], square.shape[0]) + first_px
        true_px = transform_points(H_thermal_satellite, corners_px)
        return _at_one_gsd(row, satellite, square, true_px)


def has_pair_columns(table: Path) -> bool:
    """Tell whether a CSV table is one of pairs."""
    try:
        with table.open(encoding="utf-8-sig", newline="") as handle:
            columns = csv.DictReader(handle).fieldnames or ()
    except (OSError, UnicodeDecodeError, csv.Error):
        return False
    return set(NAMED) <= set(columns)


def _at_one_gsd(
    row: _Row, satellite: NDArray[np.uint8], thermal: NDArray[np.uint8], true_px: FloatArray
) -> MatchSample:
    """Return the pair with the coarser image enlarged, so that no detail is lost."""
    thermal_px, satellite_px = thermal.shape[0], satellite.shape[0]
    thermal_gsd_m = row.thermal_gsd_m
    if thermal_gsd_m is None:
        ratio = math.sqrt(area_px(true_px)) / (thermal_px - 1)
        thermal_gsd_m = ratio * row.satellite_gsd_m
    gsd_m = min(row.satellite_gsd_m, thermal_gsd_m)
    new_satellite_px = round(satellite_px * row.satellite_gsd_m / gsd_m)
    new_thermal_px = round(thermal_px * thermal_gsd_m / gsd_m)
    H_satellite = resize_homography((satellite_px, satellite_px), (new_satellite_px,) * 2)
    old_to_new = resize_homography((thermal_px, thermal_px), (new_thermal_px,) * 2)
    in_old_px = transform_points(
        np.asarray(np.linalg.inv(old_to_new)), image_corners_px(new_thermal_px, new_thermal_px)
    )
    H_thermal_satellite = homography_from_corners(image_corners_px(thermal_px, thermal_px), true_px)
    corners_px = transform_points(H_satellite @ H_thermal_satellite, in_old_px)
    return MatchSample(
        row.name,
        _resized(satellite, new_satellite_px),
        _resized(thermal, new_thermal_px),
        corners_px,
        row.satellite_gsd_m * satellite_px / new_satellite_px,
    )


def _corners_px(row: _Row, thermal: NDArray[np.uint8]) -> FloatArray:
    """Return the true corners of the whole thermal image, in satellite pixels."""
    if row.corners_px is not None:
        return row.corners_px
    assert row.centre_px is not None and row.thermal_gsd_m is not None  # _parse has seen to it
    height_px, width_px = thermal.shape
    corners = image_corners_px(width_px, height_px)
    scale = row.thermal_gsd_m / row.satellite_gsd_m
    return np.asarray((corners - corners.mean(axis=0)) * scale + row.centre_px)


def _middle_square(image: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], FloatArray]:
    """Return the largest square about an image's middle, and its first pixel ``(x, y)``."""
    height_px, width_px = image.shape[:2]
    side_px = min(height_px, width_px)
    x, y = (width_px - side_px) // 2, (height_px - side_px) // 2
    return cut_square(image, (x, y), side_px), np.array([x, y], dtype=np.float64)


def _resized(image: NDArray[np.uint8], side_px: int) -> NDArray[np.uint8]:
    """Return a square image at another size, enlarged if at all."""
    if image.shape[0] == side_px:
        return image
    return np.asarray(cv2.resize(image, (side_px, side_px), interpolation=cv2.INTER_LINEAR))


def _read(path: Path, mode: int) -> NDArray[np.uint8]:
    image = cv2.imread(str(path), mode)
    if image is None:
        raise DatasetError(f"{path} is no readable image")
    return image_u8(np.asarray(image))


def _read_table(table: Path) -> list[_Row]:
    try:
        with table.open(encoding="utf-8-sig", newline="") as handle:
            reader = csv.DictReader(handle)
            missing = [name for name in NAMED if name not in (reader.fieldnames or ())]
            if missing:
                raise DatasetError(f"{table}: column {', '.join(missing)} is missing")
            rows = [_parse(row, table.parent, f"{table}:{reader.line_num}") for row in reader]
    except OSError as error:
        raise DatasetError(f"{table} cannot be read: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise DatasetError(f"{table} is no CSV table in UTF-8: {error}") from error
    if not rows:
        raise DatasetError(f"{table} has no rows")
    return rows


def _parse(row: Mapping[str, Any], folder: Path, where: str) -> _Row:
    thermal_gsd_m = _positive(row, "thermal_gsd_m", where) if row.get("thermal_gsd_m") else None
    corners = centre = None
    if all(row.get(name) for name in CORNERS):
        corners = np.array([_number(row, name, where) for name in CORNERS]).reshape(4, 2)
    elif all(row.get(name) for name in CENTRED):
        centre = np.array([_number(row, name, where) for name in CENTRED[:2]])
    else:
        raise DatasetError(
            f"{where}: give the corners ({', '.join(CORNERS)}) or {', '.join(CENTRED)}"
        )
    satellite_gsd_m = _positive(row, "satellite_gsd_m", where)
    paths = (folder / str(row["satellite"]), folder / str(row["thermal"]))
    return _Row(str(row["name"]), *paths, satellite_gsd_m, corners, centre, thermal_gsd_m)


def _positive(row: Mapping[str, Any], column: str, where: str) -> float:
    value = _number(row, column, where)
    if value <= 0:
        raise DatasetError(f"{where}: {column} is {value:g}, expected a number above 0")
    return value


def _number(row: Mapping[str, Any], column: str, where: str) -> float:
    try:
        value = float(row[column])
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise DatasetError(f"{where}: {column} is {row[column]!r}, expected a number")
    return value
