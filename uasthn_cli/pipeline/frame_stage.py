"""One frame through rectify, search, consensus, decision and placement."""

import numpy as np

from uasthn_cli.config import GeotagConfig
from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    homography_from_corners,
    transform_points,
)
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m
from uasthn_cli.geometry.pixels import metres_to_grid
from uasthn_cli.geometry.placement import Placement, box_origin, place_frame, translation
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.ingest.frames import UnreadableFrameError, read_frame
from uasthn_cli.mapping.ortho import (
    FootprintSizeError,
    ObliqueFrameError,
    TexturelessFrameError,
    rectify,
)
from uasthn_cli.mapping.tiles import FeatureTiles, aligned_box
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.types import (
    CameraModel,
    Decision,
    Estimate,
    Estimator,
    Fix,
    FloatArray,
    FrameFailure,
    FrameResult,
    MapFeatures,
    MapGrid,
    Ortho,
    Prior,
    Reason,
    Spread,
)
from uasthn_cli.uncertainty.consensus import spread_of_views
from uasthn_cli.uncertainty.decide import decide
from uasthn_cli.uncertainty.views import crop_views_px

_ALIGNMENT_PX = 16
_MIN_VALID_FRACTION = 0.5


class FrameStage:
    """Locates frames one by one; holds what all frames of a flight share."""

    def __init__(
        self,
        camera: CameraSpec,
        grid: MapGrid,
        tiles: FeatureTiles,
        estimator: Estimator,
        local: LocalFrame,
        config: GeotagConfig,
        timer: StageTimer,
    ) -> None:
        """Keep the flight's camera, map features, estimator, frame of reference and settings."""
        self._camera, self._grid, self._tiles, self._estimator = camera, grid, tiles, estimator
        self._local, self._config, self._timer = local, config, timer

    def locate(self, prior: Prior) -> FrameResult:
        """Return where a frame was taken, or why that cannot be said."""
        try:
            with self._timer.stage("decode"):
                image = read_frame(prior.frame.path)
            height_px, width_px = image.shape
            camera = self._camera.model_of_frame(prior.frame.path, width_px, height_px)
            with self._timer.stage("rectify"):
                thermal = rectify(image, camera, prior, self._grid.gsd_m, multiple_px=_ALIGNMENT_PX)
            return self._match(prior, camera, thermal)
        except UnreadableFrameError as error:
            return _failure(prior, Reason.UNREADABLE, error)
        except ObliqueFrameError as error:
            return _failure(prior, Reason.TOO_OBLIQUE, error)
        except FootprintSizeError as error:
            return _failure(prior, Reason.NO_PRIOR, error)
        except TexturelessFrameError as error:
            return _failure(prior, Reason.TEXTURELESS, error)
        except DegenerateHomographyError as error:
            return _failure(prior, Reason.DEGENERATE_HOMOGRAPHY, error)

    def _match(self, prior: Prior, camera: CameraModel, thermal: Ortho) -> FrameResult:
        """Search the map around the prior and judge what was found."""
        grid = self._grid
        nadir_m = self._local.to_metres(np.array([prior.lat_deg, prior.lon_deg]))
        ortho_origin_px = metres_to_grid(grid, nadir_m) - thermal.nadir_px
        features = self._read_window(thermal, ortho_origin_px)
        if not features.valid.any():
            return _failure(prior, Reason.OFF_MAP, "the search window has no map data")
        frame_views = crop_views_px(
            camera.width_px, camera.height_px, self._config.crops, prior.frame.name
        )
        views = transform_points(thermal.H_frame_ortho, frame_views)
        origin_px = ortho_origin_px - box_origin(features.box)
        with self._timer.stage("search"):
            estimate = self._estimator.estimate(features, thermal, views, origin_px)
        spread = spread_of_views(views, estimate.corners_px[-1], self._config.aggregation)
        decision = self._decide(estimate, spread, views, features)
        H_ortho_grid = translation(box_origin(features.box)) @ homography_from_corners(
            views[0], spread.corners_px
        )
        return self._fix(prior, camera, thermal, H_ortho_grid, spread, decision, estimate)

    def _read_window(self, thermal: Ortho, ortho_origin_px: FloatArray) -> MapFeatures:
        """Return map features of the ortho's box grown by the search radius."""
        height_px, width_px = thermal.image.shape
        reach_px = 2 * self._config.search_radius_m / thermal.gsd_m
        centre_px = ortho_origin_px + (np.array([width_px, height_px]) - 1) / 2
        box = aligned_box(
            (float(centre_px[0]), float(centre_px[1])),
            width_px + reach_px,
            height_px + reach_px,
            _ALIGNMENT_PX,
        )
        with self._timer.stage("map"):
            return self._tiles.read(box)

    def _decide(
        self, estimate: Estimate, spread: Spread, views: FloatArray, features: MapFeatures
    ) -> Decision:
        """Judge the estimate; one that hangs over the map's edge is ``off-map`` whatever else."""
        gsd_m = features.grid.gsd_m
        decision = decide(
            spread.std_px * gsd_m,
            estimate.confidence,
            views[0],
            spread.corners_px,
            features.box.width_px * gsd_m,
            self._config.decision,
        )
        if _valid_fraction(features, spread.corners_px) < _MIN_VALID_FRACTION:
            return Decision(False, decision.uncertainty_m, Reason.OFF_MAP)
        return decision

    def _fix(
        self,
        prior: Prior,
        camera: CameraModel,
        thermal: Ortho,
        H_ortho_grid: FloatArray,
        spread: Spread,
        decision: Decision,
        estimate: Estimate,
    ) -> Fix:
        grid = self._grid
        placed = self._place(camera, thermal, H_ortho_grid, grid)
        degrees = placed.in_degrees(self._local)
        prior_deg = np.array([prior.lat_deg, prior.lon_deg])
        return Fix(
            prior=prior,
            lat_deg=float(degrees[0, 0]),
            lon_deg=float(degrees[0, 1]),
            center_lat_deg=float(degrees[1, 0]),
            center_lon_deg=float(degrees[1, 1]),
            corners_deg=degrees[2:],
            corner_std_m=spread.std_px * grid.gsd_m,
            uncertainty_m=decision.uncertainty_m,
            offset_m=float(distance_m(degrees[0], prior_deg)),
            yaw_deg=placed.yaw_deg,
            gsd_m=placed.gsd_m,
            confidence=estimate.confidence,
            accepted=decision.accepted,
            reason=decision.reason,
        )

    def _place(
        self, camera: CameraModel, thermal: Ortho, H_ortho_grid: FloatArray, grid: MapGrid
    ) -> Placement:
        nadir_grid_px = transform_points(H_ortho_grid, thermal.nadir_px[None])[0]
        return place_frame(camera, H_ortho_grid @ thermal.H_frame_ortho, nadir_grid_px, grid)


def _valid_fraction(features: MapFeatures, corners_px: FloatArray) -> float:
    """Return the share of the estimated footprint's sample points that lie on valid map."""
    steps = np.linspace(0.05, 0.95, 10)
    square = np.array([(x, y) for y in steps for x in steps])
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    points = transform_points(homography_from_corners(unit, corners_px), square)
    cells = np.floor((points + 0.5) / features.stride_px).astype(int)
    rows, columns = features.valid.shape
    inside = (cells >= 0).all(axis=1) & (cells[:, 0] < columns) & (cells[:, 1] < rows)
    return float(features.valid[cells[inside, 1], cells[inside, 0]].sum() / len(points))


def _failure(prior: Prior, reason: Reason, detail: object) -> FrameFailure:
    return FrameFailure(prior.frame, reason, str(detail), prior.time_utc_s, prior)
