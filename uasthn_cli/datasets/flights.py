"""Flights with truth as pairs: real frames, rectified by what their log says, on their map.

A flight is a folder with ``flight.tlog``, ``frames/``, ``map.tif`` and ``truth.csv``, as
``uasthn synth`` writes it. Of each rectified frame the largest upright square is used.
"""

import logging
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from uasthn_cli.config import MAX_MAP_ENLARGEMENT, PriorConfig
from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.datasets.windows import (
    draw_offset_m,
    evenly,
    sample_rng,
    satellite_u8,
    thermal_u8,
)
from uasthn_cli.errors import CameraError, DatasetError
from uasthn_cli.geometry.camera import undistort_points
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.pixels import metres_to_grid
from uasthn_cli.ingest.cameras import FocalLengthUnknownError
from uasthn_cli.ingest.frames import UnreadableFrameError, frame_size_px, list_frames, read_frame
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.ingest.priors import build_priors
from uasthn_cli.mapping.ortho import (
    FootprintSizeError,
    ObliqueFrameError,
    TexturelessFrameError,
    rectify,
)
from uasthn_cli.mapping.reader import MapReader, native_gsd_m
from uasthn_cli.outputs.truth import TrueFrame, read_truth
from uasthn_cli.types import BoolArray, CameraModel, FloatArray, GridBox, Ortho, Prior

_log = logging.getLogger(__name__)

PARTS: Final = ("flight.tlog", "frames", "map.tif", "truth.csv")

_MIN_THERMAL_PX: Final = 24
_LARGEST_THERMAL_PX: Final = 512
"""Finer grids than this many pixels across a footprint show nothing more, and take long."""


class FlightDataset:
    """The frames of one flight whose truth is known, rectified and cut when asked for.

    The satellite window is centred within D_C of the truth, or, where ``spec.max_offset_m`` is
    None, where the log has the frame. Attitude and height are always the log's, errors included.
    """

    def __init__(self, folder: Path, spec: DatasetSpec) -> None:
        """Read log and truth, and choose the grid: at most twice as fine as the map.

        Raises:
            DatasetError: no frame has both a truth and a usable prior.
            UasthnError: a part of the flight cannot be read.
        """
        self._map_path, self._spec = folder / "map.tif", spec
        truth = read_truth(folder / "truth.csv").frames
        frames = [frame for frame in list_frames(folder / "frames") if frame.name in truth]
        priors = build_priors(
            read_telemetry(folder / "flight.tlog"), frames, config=PriorConfig()
        ).results
        usable = [prior for prior in priors if isinstance(prior, Prior)]
        self._truth: dict[str, TrueFrame] = {p.frame.name: truth[p.frame.name] for p in usable}
        if not usable:
            raise DatasetError(f"{folder}: no frame has a place both in the log and in truth.csv")
        self._frame = LocalFrame(*np.median([(p.lat_deg, p.lon_deg) for p in usable], axis=0))
        self._gsd_m = spec.gsd_m or self._finest_gsd_m(usable)
        self._priors = self._shown(usable)
        if not self._priors:
            raise DatasetError(
                f"{folder}: at {self._gsd_m:.2g} m a pixel no frame shows a square of"
                f" {_MIN_THERMAL_PX} px: check --hfov, or give a smaller --gsd"
            )

    def __getstate__(self) -> dict[str, Any]:
        """Leave the open map behind: another process opens its own."""
        return {name: value for name, value in self.__dict__.items() if name != "_reader"}

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._priors)

    def __getitem__(self, index: int) -> MatchSample:
        """Rectify a frame and read the map around it.

        Raises:
            IndexError: there are not so many.
            MapUnreadableError: the map is damaged where it was read.
        """
        if not 0 <= index < len(self):
            raise IndexError(index)
        prior = self._priors[index]
        camera = self._camera(prior)
        ortho = rectify(read_frame(prior.frame.path), camera, prior, self._gsd_m)
        first_px, side_px = _largest_square(ortho.valid, self._most_px)
        square_px = image_corners_px(side_px, side_px) + first_px
        thermal = ortho.image[first_px[1] :, first_px[0] :][:side_px, :side_px]
        true_px = self._true_grid_px(prior, camera, ortho, square_px)
        box = self._window(prior, ortho, square_px, true_px)
        window = self._map().read(box)
        return MatchSample(
            prior.frame.name,
            satellite_u8(window.image, window.valid),
            thermal_u8(thermal),
            true_px - (box.column_px, box.row_px),
            self._gsd_m,
        )

    @property
    def _most_px(self) -> int:
        return max(_MIN_THERMAL_PX, round(self._spec.thermal_m / self._gsd_m))

    def _map(self) -> MapReader:
        if not hasattr(self, "_reader"):
            self._reader = MapReader(self._map_path, self._frame, self._gsd_m)
        return self._reader

    def _camera(self, prior: Prior) -> CameraModel:
        size_px = frame_size_px(prior.frame.path)
        return self._spec.camera.model_of_frame(prior.frame.path, *size_px)

    def _first_camera(self, priors: list[Prior]) -> CameraModel:
        """Return the camera of the first frame that can be read.

        Raises:
            CameraError: neither the description nor the frame tells a focal length.
            DatasetError: no frame can be read.
        """
        for prior in priors:
            try:
                return self._camera(prior)
            except FocalLengthUnknownError as error:
                raise CameraError(f"{prior.frame.path}: {error}") from error
            except UnreadableFrameError as error:
                _log.debug("%s: %s", prior.frame.name, error)
        raise DatasetError(f"{priors[0].frame.path.parent}: no frame can be read")

    def _finest_gsd_m(self, priors: list[Prior]) -> float:
        """Return half the map's pixel, or more where a footprint would have too many of them."""
        camera = self._first_camera(priors)
        height_m = float(np.median([prior.height_above_ground_m for prior in priors]))
        footprint_m = height_m * camera.width_px / camera.focal_x_px
        native_m = native_gsd_m(self._map_path, self._frame)
        return max(native_m / MAX_MAP_ENLARGEMENT, footprint_m / _LARGEST_THERMAL_PX)

    def _shown(self, priors: list[Prior]) -> list[Prior]:
        """Return the frames that are used, spread over the flight; no others are looked at.

        One that shows nothing leaves its place to the nearest frame that does.
        """
        every = np.arange(len(priors))
        wanted = every if self._spec.samples is None else evenly(every, self._spec.samples)
        spare = sorted(set(every.tolist()) - set(wanted.tolist()))
        shown = []
        for place in wanted.tolist():
            index: int | None = place
            while index is not None and not self._has_square(priors[index]):
                index = _take_nearest(spare, place)
            if index is not None:
                shown.append(index)
        return [priors[index] for index in sorted(shown)]

    def _has_square(self, prior: Prior) -> bool:
        """Tell whether a frame can be read and rectified, and shows enough."""
        name = prior.frame.name
        try:
            ortho = rectify(read_frame(prior.frame.path), self._camera(prior), prior, self._gsd_m)
        except UnreadableFrameError as error:
            _log.warning("%s is skipped: %s", name, error)
            return False
        except (ObliqueFrameError, FootprintSizeError, TexturelessFrameError) as error:
            _log.info("%s is skipped: %s", name, error)
            return False
        return _largest_square(ortho.valid, self._most_px)[1] >= _MIN_THERMAL_PX

    def _true_grid_px(
        self, prior: Prior, camera: CameraModel, ortho: Ortho, square_px: FloatArray
    ) -> FloatArray:
        """Return where points of the ortho truly lie on the map grid, by the frame's truth."""
        true_m = self._frame.to_metres(self._truth[prior.frame.name].corners_deg)
        frame_px = undistort_points(camera, image_corners_px(camera.width_px, camera.height_px))
        H_frame_grid = homography_from_corners(frame_px, metres_to_grid(self._map().grid, true_m))
        H_ortho_frame = np.asarray(np.linalg.inv(ortho.H_frame_ortho))
        return transform_points(H_frame_grid @ H_ortho_frame, square_px)

    def _window(
        self, prior: Prior, ortho: Ortho, square_px: FloatArray, true_px: FloatArray
    ) -> GridBox:
        """Return the satellite window, centred where a prior would have the square's middle."""
        grid = self._map().grid
        if self._spec.max_offset_m is None:
            camera_m = self._frame.to_metres(np.array([prior.lat_deg, prior.lon_deg]))
            centre_px = metres_to_grid(grid, camera_m) - ortho.nadir_px + square_px.mean(axis=0)
        else:
            rng = sample_rng(self._spec.seed, 0, prior.frame.name)
            offset_m = draw_offset_m(rng, self._spec.max_offset_m)
            centre_px = true_px.mean(axis=0) + offset_m / grid.gsd_m
        thermal_m = (square_px[1, 0] - square_px[0, 0] + 1) * grid.gsd_m
        side_px = round(self._spec.flight_window_m(float(thermal_m)) / grid.gsd_m)
        first_px = np.round(centre_px - (side_px - 1) / 2).astype(int)
        return GridBox(int(first_px[0]), int(first_px[1]), side_px, side_px)


def is_flight(folder: Path) -> bool:
    """Tell whether a folder holds all parts of a flight."""
    return all((folder / part).exists() for part in PARTS)


def _take_nearest(spare: list[int], place: int) -> int | None:
    """Take the number nearest to a place out of a list; None where it is empty."""
    nearest = min(spare, key=lambda index: abs(index - place), default=None)
    if nearest is not None:
        spare.remove(nearest)
    return nearest


def _largest_square(valid: BoolArray, most_px: int) -> tuple[tuple[int, int], int]:
    """Return the first pixel ``(x, y)`` and side of the largest upright square of valid pixels.

    At most ``most_px`` wide; by the distance to the nearest pixel that is not valid, in moves of a
    chess king.
    """
    padded = np.pad(valid, 1).astype(np.uint8)
    distance = cv2.distanceTransform(padded, cv2.DIST_C, 3)[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(distance)), distance.shape)
    reach_px = min(int(distance[row, column]) - 1, (most_px - 1) // 2)
    return (int(column) - reach_px, int(row) - reach_px), 2 * reach_px + 1
