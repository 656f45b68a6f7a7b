"""Evaluate weights on held real pixels: single frames of two flights and crops of one pair.

Besides errors it takes the search's posterior at the true place, which tells two weights apart long
before their hits do.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from uasthn_cli.config import CropTtaConfig, GeotagConfig
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.pixels import metres_to_grid
from uasthn_cli.geometry.placement import box_origin
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.mapping.radiometry import find_statistics
from uasthn_cli.matching.architecture import STRIDE_PX
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_encoders import TorchEncoders
from uasthn_cli.matching.xcorr import XcorrEstimator
from uasthn_cli.outputs.truth import center_error_m, read_truth
from uasthn_cli.pipeline import GeotagJob, open_run
from uasthn_cli.seam import Estimate
from uasthn_cli.training.fields import resize_square
from uasthn_cli.types import (
    Fix,
    FloatArray,
    GridBox,
    ImageArray,
    MapFeatures,
    MapGrid,
    MapWindow,
    Ortho,
)

HFOV_DEG = 45.0
FLIGHTS = (("farms_bing", 200.0, 10.0), ("dunes_east", 450.0, 20.0))
"""Folder, search radius in metres, and the radius in metres that its truth is good for."""

PAIR = "pair"
_PAIR_TRUTH_M = 20.0
_PAIR_SATELLITE_M, _PAIR_THERMAL_M, _PAIR_CROP_M = 1536.0, 512.0, 256.0
_CROP_PX = 96
_CROPS_PER_SIDE = 3
_FLOOR = 0.01
"""Share of the posterior that is spread evenly: one lost frame must not outweigh all others."""


@dataclass(frozen=True, slots=True)
class FrameScore:
    """One frame: its error east, north and in all, and the log posterior at its true place.

    ``log_posterior`` is that of the mass within the radius that the truth is good for, floored; 0
    would be certainty.
    """

    frame: str
    east_m: float
    north_m: float
    ce_m: float
    log_posterior: float


class ProbedXcorr(XcorrEstimator):
    """The learned features alone, with the scores of the frame that was seen last."""

    def __init__(self, model: XcorrModel) -> None:
        """See one symmetry, on the CPU."""
        super().__init__(TorchEncoders(model), symmetries=1, appearance=False)
        self.scores: FloatArray = np.zeros((0, 0))
        self.centre_px: FloatArray = np.zeros(2)
        self.box = GridBox(0, 0, 0, 0)

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return the search's answer, and remember the scores of all allowed shifts."""
        estimate = super().estimate(features, thermal, views_px, origin_px, evidence)
        if estimate.scores is not None:
            self.scores = estimate.scores
        self.box, self.centre_px = features.box, _frame_centre_px(thermal, views_px)
        return estimate

    def log_posterior(self, true_centre_px: FloatArray, radius_px: float) -> float:
        """Return the log of the posterior mass around a true frame centre, in window pixels."""
        shift = (true_centre_px - self.centre_px) / STRIDE_PX
        finite = np.isfinite(self.scores)
        weights = np.where(finite, np.exp(self.scores - self.scores[finite].max()), 0.0)
        rows, columns = np.ogrid[: self.scores.shape[0], : self.scores.shape[1]]
        near = np.hypot(columns - shift[0], rows - shift[1]) <= radius_px / STRIDE_PX
        even = (near & finite).sum() / finite.sum()
        mass = float((1 - _FLOOR) * weights[near].sum() / weights.sum() + _FLOOR * even)
        return math.log(max(mass, 1e-12))


def evaluate(model: XcorrModel, shared: Path) -> dict[str, list[FrameScore]]:
    """Return the scores of every frame of the flights and every crop of the pair."""
    scores = {
        name: list(_flight_scores(model, shared / "flights" / name, radius_m, truth_m))
        for name, radius_m, truth_m in FLIGHTS
    }
    scores[PAIR] = list(_pair_scores(model, shared / "pairs"))
    return scores


def _frame_centre_px(thermal: Ortho, views_px: FloatArray) -> FloatArray:
    """Return the ortho pixel of the frame's middle: where the full view's corners come from."""
    H_ortho_frame = np.asarray(np.linalg.inv(thermal.H_frame_ortho), np.float64)
    corners = transform_points(H_ortho_frame, views_px[0])
    centre: FloatArray = transform_points(thermal.H_frame_ortho, corners.mean(axis=0)[None])[0]
    return centre


def _flight_scores(
    model: XcorrModel, folder: Path, radius_m: float, truth_m: float
) -> Iterator[FrameScore]:
    truth = read_truth(folder / "truth.csv")
    job = GeotagJob(
        log_path=folder / "flight.tlog",
        frames_path=folder / "frames",
        map_path=folder / "map.tif",
        camera=CameraSpec(hfov_deg=HFOV_DEG),
        config=GeotagConfig(search_radius_m=radius_m, crops=CropTtaConfig(views=1)),
    )
    probe = ProbedXcorr(model)
    with open_run(job, probe) as run:
        origin = run.describe()["local_origin"]
        local = LocalFrame(origin["lat"], origin["lon"])
        grid = MapGrid(run.describe()["map_gsd_m"])
        for located in run.locate():  # one by one: the probe knows the frame seen last
            result = located.result
            if not isinstance(result, Fix) or result.prior.frame.name not in truth.frames:
                continue
            true = truth.frames[result.prior.frame.name]
            true_m = local.to_metres(true.center_deg)
            found_m = local.to_metres(np.array([result.center_lat_deg, result.center_lon_deg]))
            true_px = metres_to_grid(grid, true_m) - box_origin(probe.box)
            yield FrameScore(
                frame=result.prior.frame.name,
                east_m=float(found_m[0] - true_m[0]),
                north_m=float(found_m[1] - true_m[1]),
                ce_m=center_error_m(result, true),
                log_posterior=probe.log_posterior(true_px, truth_m / grid.gsd_m),
            )


def _pair_scores(model: XcorrModel, folder: Path) -> Iterator[FrameScore]:
    """Yield nine overlapping crops of the thermal image, searched from the map's middle."""
    gsd_m = _PAIR_CROP_M / _CROP_PX
    side_px = round(_PAIR_SATELLITE_M / gsd_m)
    satellite = _read(folder / "p3_satellite_1536m.png", cv2.IMREAD_COLOR_RGB, side_px)
    thermal = _read(folder / "p3_thermal_512m.png", cv2.IMREAD_GRAYSCALE, 2 * _CROP_PX)
    probe, box = ProbedXcorr(model), GridBox(0, 0, side_px, side_px)
    whole = np.ones((side_px, side_px), np.bool_)
    statistics = find_statistics(satellite.reshape(-1, 3))
    encoded = probe.encode_map(MapWindow(satellite, whole, box, MapGrid(gsd_m), statistics))
    cells = whole[::STRIDE_PX, ::STRIDE_PX]
    features = MapFeatures(encoded, cells, box, MapGrid(gsd_m), STRIDE_PX)
    views = image_corners_px(_CROP_PX, _CROP_PX)[None]
    first_px = (_PAIR_SATELLITE_M - _PAIR_THERMAL_M) / 2 / gsd_m
    start_px = np.full(2, (side_px - _CROP_PX) / 2)
    for row, column in np.ndindex(_CROPS_PER_SIDE, _CROPS_PER_SIDE):
        x_px, y_px = (n * _CROP_PX // (_CROPS_PER_SIDE - 1) for n in (column, row))
        crop = thermal[y_px : y_px + _CROP_PX, x_px : x_px + _CROP_PX]
        seen = np.ones(crop.shape, np.bool_)
        ortho = Ortho(crop, seen, gsd_m, np.eye(3), np.full(2, (_CROP_PX - 1) / 2))
        found_px = probe.estimate(features, ortho, views, start_px).corners_px[0, 0]
        true_px = first_px + np.array([x_px, y_px], np.float64)
        east_m, south_m = (found_px - true_px) * gsd_m
        centre_px = true_px + (_CROP_PX - 1) / 2
        yield FrameScore(
            frame=f"crop {row} {column}",
            east_m=float(east_m),
            north_m=float(-south_m),
            ce_m=float(np.hypot(east_m, south_m)),
            log_posterior=probe.log_posterior(centre_px, _PAIR_TRUTH_M / gsd_m),
        )


def _read(path: Path, mode: int, side_px: int) -> ImageArray:
    """Return a square image in 0..1, resized."""
    image = cv2.imread(str(path), mode)
    if image is None:
        raise FileNotFoundError(path)
    return resize_square(image.astype(np.float32) / 255, side_px)
