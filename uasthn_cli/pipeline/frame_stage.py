"""One frame alone: search, consensus of its views, and what that is worth."""

from dataclasses import replace

import numpy as np

from uasthn_cli.config import CropTtaConfig, GeotagConfig
from uasthn_cli.fusion.offsets import OffsetGrid, grid_of_radius
from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    homography_from_corners,
    transform_points,
)
from uasthn_cli.geometry.geodesy import distance_m
from uasthn_cli.geometry.placement import Placement, box_origin, place_frame, translation
from uasthn_cli.pipeline.frame_matcher import FrameMatch, FrameMatcher, UnmatchableFrameError
from uasthn_cli.pipeline.likelihoods import likelihood_of_match
from uasthn_cli.pipeline.trust_model import TrustModel
from uasthn_cli.types import (
    Fix,
    FloatArray,
    FrameFailure,
    Located,
    MapFeatures,
    OffsetLikelihood,
    Prior,
    Reason,
    Spread,
    Trust,
)
from uasthn_cli.uncertainty.consensus import spread_of_frame
from uasthn_cli.uncertainty.decide import (
    Rejection,
    impossible_corners,
    scalar_uncertainty,
    told_apart,
)
from uasthn_cli.uncertainty.methods import OF_CROPS, UncertaintyChoice

_MIN_VALID_FRACTION = 0.5


class FrameStage:
    """Locates frames one by one."""

    def __init__(
        self,
        matcher: FrameMatcher,
        trust_model: TrustModel,
        config: GeotagConfig,
        uncertainty: UncertaintyChoice,
    ) -> None:
        """Keep how frames are matched and trusted, and how far their answers are known."""
        self._matcher, self._trust_model, self._config = matcher, trust_model, config
        self._uncertainty = uncertainty

    @property
    def crops(self) -> CropTtaConfig:
        """The views of each frame: the whole frame alone where nobody compares them."""
        is_compared = self._uncertainty.method in OF_CROPS
        return self._config.crops if is_compared else replace(self._config.crops, views=1)

    @property
    def offset_grid(self) -> OffsetGrid:
        """The offsets within the search radius that are told apart."""
        return grid_of_radius(self._config.search_radius_m, self._matcher.pitch_m)

    def locate(self, prior: Prior) -> Located:
        """Return where a frame was taken, or why that cannot be said."""
        try:
            match = self._matcher.match(prior, self.crops, self._config.search_radius_m)
            spread = spread_of_frame(
                match.views_px,
                match.estimate.corners_px,
                self._uncertainty,
                members=match.members_px,
                modelled_std=match.estimate.modelled_std_px,
            )
            H_ortho_window = homography_from_corners(match.views_px[0], spread.corners_px)
        except UnmatchableFrameError as error:
            return Located(failure(prior, error.reason, error), None)
        except DegenerateHomographyError as error:
            return Located(failure(prior, Reason.DEGENERATE_HOMOGRAPHY, error), None)
        likelihood = likelihood_of_match(match, self.offset_grid, np.zeros(2))
        return Located(self._fix(prior, match, spread, H_ortho_window, likelihood), likelihood)

    def _fix(
        self,
        prior: Prior,
        match: FrameMatch,
        spread: Spread,
        H_ortho_window: FloatArray,
        likelihood: OffsetLikelihood | None,
    ) -> Fix:
        local, grid = self._matcher.local, self._matcher.grid
        placed = self._placed(prior, match, H_ortho_window)
        degrees = placed.in_degrees(local)
        prior_deg = np.array([prior.lat_deg, prior.lon_deg])
        offset_m = placed.camera_m - local.to_metres(prior_deg)
        std_m = spread.std_px * grid.gsd_m
        uncertainty_m = scalar_uncertainty(std_m, self._config.decision.rule)
        trust = self._trust_model.single(
            likelihood, offset_m, uncertainty_m, match.estimate.confidence, std_m
        )
        camera = self._trust_model.camera(trust, placed.attitude, prior.height_above_ground_m)
        roll_deg, pitch_deg, yaw_deg = placed.angles_deg
        rejection = self._rejection(match, spread, uncertainty_m, trust)
        return Fix(
            prior=prior,
            lat_deg=float(degrees[0, 0]),
            lon_deg=float(degrees[0, 1]),
            center_lat_deg=float(degrees[1, 0]),
            center_lon_deg=float(degrees[1, 1]),
            corners_deg=degrees[2:],
            corner_std_m=std_m,
            uncertainty_m=uncertainty_m,
            offset_m=float(distance_m(degrees[0], prior_deg)),
            roll_deg=roll_deg,
            pitch_deg=pitch_deg,
            yaw_deg=yaw_deg,
            height_above_ground_m=prior.height_above_ground_m,
            alt_amsl_m=prior.alt_amsl_m,
            gsd_m=placed.gsd_m,
            trust=trust,
            camera_covariance_m2=camera.covariance_m2,
            camera_ce90_m=camera.ce90_m,
            accepted=rejection is None,
            reason=rejection.reason if rejection else None,
            detail=rejection.detail if rejection else "",
        )

    def _rejection(
        self, match: FrameMatch, spread: Spread, uncertainty_m: float, trust: Trust
    ) -> Rejection | None:
        """Return why an estimate is rejected; one beyond the map's edge is, whatever else."""
        on_map = valid_fraction(match.scene.features, spread.corners_px)
        if on_map < _MIN_VALID_FRACTION:
            found, least = told_apart(on_map, _MIN_VALID_FRACTION)
            detail = f"{found} of the footprint found lie on the map, {least} needed"
            return Rejection(Reason.OFF_MAP, detail)
        limit = self._config.decision.max_scale_error
        return impossible_corners(
            match.views_px[0], spread.corners_px, limit
        ) or self._trust_model.rejection_of_single(
            uncertainty_m, trust, match.scene.features.box.width_px * self._matcher.grid.gsd_m
        )

    def _placed(self, prior: Prior, match: FrameMatch, H_ortho_window: FloatArray) -> Placement:
        scene = match.scene
        H_ortho_grid = translation(box_origin(scene.features.box)) @ H_ortho_window
        nadir_grid_px = transform_points(H_ortho_grid, scene.thermal.nadir_px[None])[0]
        H_frame_grid = H_ortho_grid @ scene.thermal.H_frame_ortho
        grid = self._matcher.grid
        return place_frame(scene.camera, prior.attitude, H_frame_grid, nadir_grid_px, grid)


def valid_fraction(features: MapFeatures, corners_px: FloatArray) -> float:
    """Return the share of a footprint's sample points that lie on valid map.

    ``corners_px`` ``(4, 2)`` in window pixels.
    """
    steps = np.linspace(0.05, 0.95, 10)
    square = np.array([(x, y) for y in steps for x in steps])
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    points = transform_points(homography_from_corners(unit, corners_px), square)
    cells = np.floor((points + 0.5) / features.stride_px).astype(int)
    rows, columns = features.valid.shape
    inside = (cells >= 0).all(axis=1) & (cells[:, 0] < columns) & (cells[:, 1] < rows)
    return float(features.valid[cells[inside, 1], cells[inside, 0]].sum() / len(points))


def failure(prior: Prior, reason: Reason, detail: object) -> FrameFailure:
    """Return a frame without an estimate."""
    return FrameFailure(prior.frame, reason, str(detail), prior.time_utc_s, prior)
