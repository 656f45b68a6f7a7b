"""Ground truth of a flight, and the distance of an estimate from it."""

import csv
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from uasthn_cli.errors import TruthError
from uasthn_cli.geometry.geodesy import distance_m
from uasthn_cli.types import Fix, FloatArray, Prior

_CENTER: Final = ("center_lat", "center_lon")
_CORNERS: Final = tuple(f"{c}_{axis}" for c in ("tl", "tr", "bl", "br") for axis in ("lat", "lon"))
_CAMERA: Final = ("lat", "lon")
_REQUIRED: Final = ("frame", *_CENTER, *_CORNERS)


@dataclass(frozen=True, slots=True)
class TrueFrame:
    """Where one frame truly was, ``(lat, lon)`` in degrees.

    ``center_deg`` ``(2,)`` is the ground point of the frame centre, ``corners_deg`` ``(4, 2)`` its
    ground corners, ``camera_deg`` ``(2,)`` the camera's position if the table has it.
    """

    center_deg: FloatArray
    corners_deg: FloatArray
    camera_deg: FloatArray | None


@dataclass(frozen=True, slots=True)
class Truth:
    """A ground-truth table by frame name; ``has_camera``: it gives camera positions."""

    path: Path
    frames: Mapping[str, TrueFrame]
    has_camera: bool

    def require_match(self, frame_names: Iterable[str]) -> None:
        """Check that the table knows at least one of a flight's frames.

        Raises:
            TruthError: it knows none.
        """
        names = list(frame_names)
        if names and not any(name in self.frames for name in names):
            known = next(iter(self.frames), "nothing")
            raise TruthError(
                f"{self.path}: no frame of the flight is in it"
                f" (it lists {known!r}, the flight has {names[0]!r})"
            )


def read_truth(path: Path) -> Truth:
    """Read a CSV table of true positions.

    Columns ``frame,center_lat,center_lon`` and ``{tl,tr,bl,br}_{lat,lon}`` are required,
    ``lat,lon`` (the camera) are optional, others ignored; ``frame`` is the path relative to the
    frames folder.

    Raises:
        TruthError: the file is missing, lacks a column, repeats a frame or holds no usable number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as handle:
            reader = csv.DictReader(handle)
            columns = reader.fieldnames or ()
            missing = [name for name in _REQUIRED if name not in columns]
            if missing:
                raise TruthError(f"{path}: column {', '.join(missing)} is missing")
            has_camera = all(name in columns for name in _CAMERA)
            frames: dict[str, TrueFrame] = {}
            for row in reader:
                if row["frame"] in frames:
                    raise TruthError(f"{path}:{reader.line_num}: {row['frame']!r} is listed twice")
                frames[row["frame"]] = _parse(row, has_camera, f"{path}:{reader.line_num}")
    except OSError as error:
        raise TruthError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise TruthError(f"{path}: not a CSV table in UTF-8: {error}") from error
    if not frames:
        raise TruthError(f"{path}: the table has no rows")
    return Truth(path=path, frames=frames, has_camera=has_camera)


def center_error_m(fix: Fix, true: TrueFrame) -> float:
    """Return CE: the distance of estimated and true ground point of the frame centre."""
    estimated = np.array([fix.center_lat_deg, fix.center_lon_deg])
    return float(distance_m(estimated, true.center_deg))


def camera_error_m(fix: Fix, true: TrueFrame) -> float | None:
    """Return the distance of estimated and true camera position, None where that is unknown."""
    if true.camera_deg is None:
        return None
    return float(distance_m(np.array([fix.lat_deg, fix.lon_deg]), true.camera_deg))


def mean_corner_error_m(fix: Fix, true: TrueFrame) -> float:
    """Return MACE: the mean distance of the four estimated and true ground corners."""
    return float(distance_m(fix.corners_deg, true.corners_deg).mean())


def prior_error_m(prior: Prior, true: TrueFrame) -> float | None:
    """Return the distance of the prior's camera position from the true one, if that is known."""
    if true.camera_deg is None:
        return None
    return float(distance_m(np.array([prior.lat_deg, prior.lon_deg]), true.camera_deg))


def _parse(row: Mapping[str, str | None], has_camera: bool, where: str) -> TrueFrame:
    """Read one row; ``where`` names file and line in errors."""
    camera = _points(row, _CAMERA, where)[0] if has_camera and _any(row, _CAMERA) else None
    return TrueFrame(
        center_deg=_points(row, _CENTER, where)[0],
        corners_deg=_points(row, _CORNERS, where),
        camera_deg=camera,
    )


def _any(row: Mapping[str, str | None], columns: Iterable[str]) -> bool:
    """Tell whether any of the cells holds something."""
    return any(row[name] for name in columns)


def _points(row: Mapping[str, str | None], columns: tuple[str, ...], where: str) -> FloatArray:
    """Read alternating latitudes and longitudes as points ``(n, 2)``."""
    values = np.array([_degrees(row[name], name, where) for name in columns])
    return values.reshape(-1, 2)


def _degrees(cell: str | None, column: str, where: str) -> float:
    """Read one latitude or longitude."""
    limit = 90.0 if column.endswith("lat") else 180.0
    try:
        value = float(cell or "")
    except ValueError:
        value = math.nan
    if not abs(value) <= limit:
        raise TruthError(f"{where}: {column} is {cell!r}, expected degrees within ±{limit:.0f}")
    return value
