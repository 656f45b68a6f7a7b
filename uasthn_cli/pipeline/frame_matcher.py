"""Match one frame: decode, rectify, read the map around it, ask the estimator."""

import logging
from dataclasses import dataclass

import numpy as np

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.fusion.offsets import Placement2d, scores_elsewhere
from uasthn_cli.geometry.corners import DegenerateHomographyError, transform_points
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.pixels import metres_to_grid
from uasthn_cli.geometry.placement import box_origin
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.ingest.frames import UnreadableFrameError, frame_size_px, read_frame
from uasthn_cli.mapping.ortho import (
    FootprintSizeError,
    ObliqueFrameError,
    TexturelessFrameError,
    rectify,
)
from uasthn_cli.mapping.tiles import FeatureTiles, aligned_box
from uasthn_cli.pipeline.ground import Ground
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.seam import Estimate, Estimator
from uasthn_cli.types import (
    CameraModel,
    FloatArray,
    ImageArray,
    MapFeatures,
    MapGrid,
    Ortho,
    Prior,
    Reason,
)
from uasthn_cli.uncertainty.views import crop_views_px

_log = logging.getLogger(__name__)

_ALIGNMENT_PX = 16


class UnmatchableFrameError(Exception):
    """A frame shows nothing that could be matched; ``reason`` is one of the fixed list."""

    def __init__(self, reason: Reason, detail: object) -> None:
        """Keep the reason and one line of detail."""
        super().__init__(str(detail))
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Scene:
    """A rectified frame and the map around it; ``origin_px`` as in :class:`seam.Estimator`."""

    camera: CameraModel
    thermal: Ortho
    features: MapFeatures
    origin_px: FloatArray

    @property
    def placement(self) -> Placement2d:
        """How scores of shifts lie on the ground."""
        gsd_m = self.thermal.gsd_m
        return Placement2d(self.features.stride_px * gsd_m, self.origin_px * gsd_m)

    @property
    def shifts(self) -> tuple[int, int]:
        """Rows and columns of :attr:`uasthn_cli.seam.Estimate.scores`."""
        height_px, width_px = self.thermal.image.shape
        stride_px = self.features.stride_px
        rows, columns = self.features.valid.shape
        return rows - height_px // stride_px + 1, columns - width_px // stride_px + 1


@dataclass(frozen=True, slots=True)
class FrameMatch:
    """What an estimator saw: ``views_px`` ``(N, 4, 2)`` of the ortho and where it found them.

    ``members_px`` ``(M - 1, 4, 2)`` is where further networks found the first view.
    """

    scene: Scene
    views_px: FloatArray
    estimate: Estimate
    members_px: FloatArray


class FrameMatcher:
    """Matches frames of a flight to one map grid."""

    def __init__(
        self,
        camera: CameraSpec,
        grid: MapGrid,
        tiles: FeatureTiles,
        estimator: Estimator,
        local: LocalFrame,
        timer: StageTimer,
        *,
        second: "FrameMatcher | None" = None,
        members: "tuple[FrameMatcher, ...]" = (),
    ) -> None:
        """Keep what all frames share.

        Args:
            camera: The camera of all frames.
            grid: The map grid that frames are rectified to.
            tiles: The map's features on that grid.
            estimator: Finds a frame in features.
            local: Where metres are counted from.
            timer: Told how long each stage took.
            second: Matches at another GSD; its scores are added: two scales tell places apart
                better than one. Where the place is known, the finer one alone is more precise.
            members: Further networks of an ensemble, asked for the whole frame at the same GSD.
        """
        self.grid, self.estimator, self.local = grid, estimator, local
        self._camera, self._tiles, self._timer = camera, tiles, timer
        self._second, self._members, self._mirrored = second, members, False

    def of_mirrored_frames(self) -> "FrameMatcher":
        """Return a matcher that takes every frame for its mirror image; it has no ensemble."""
        second = None if self._second is None else self._second.of_mirrored_frames()
        shared = self._camera, self.grid, self._tiles, self.estimator, self.local, self._timer
        matcher = FrameMatcher(*shared, second=second)
        matcher._mirrored = not self._mirrored
        return matcher

    @property
    def members(self) -> int:
        """Number of networks that answer, the base network among them."""
        return 1 + len(self._members)

    @property
    def pitch_m(self) -> float:
        """Metres between neighbouring scores."""
        return self.grid.gsd_m * self.estimator.stride_px

    def camera_of(self, prior: Prior) -> CameraModel:
        """Return the camera of a frame without decoding it.

        Raises:
            UnmatchableFrameError: the frame is unreadable.
        """
        try:
            size = frame_size_px(prior.frame.path)
            return self._camera.model_of_frame(prior.frame.path, *size)
        except UnreadableFrameError as error:
            raise UnmatchableFrameError(Reason.UNREADABLE, error) from error

    def match(
        self, prior: Prior, crops: CropTtaConfig, radius_m: float, ground: Ground | None = None
    ) -> FrameMatch:
        """Search for a frame within ``radius_m`` of its prior.

        With ``ground`` it is rectified over the relief, which is right where the place is known.

        Raises:
            UnmatchableFrameError: it cannot be read or rectified, or there is nothing to search in.
        """
        return self._match(prior, self._decoded(prior), crops, radius_m, ground)

    def _match(
        self,
        prior: Prior,
        image: ImageArray,
        crops: CropTtaConfig,
        radius_m: float,
        ground: Ground | None = None,
    ) -> FrameMatch:
        scene = self._scene(prior, image, radius_m, ground)
        camera, thermal = scene.camera, scene.thermal
        evidence = None
        if self._second is not None:
            evidence = self._second.evidence(prior, image, radius_m, scene)
        frame_views = crop_views_px(camera.width_px, camera.height_px, crops, prior.frame.name)
        views = transform_points(thermal.H_frame_ortho, frame_views)
        try:
            with self._timer.stage("search"):
                estimate = self.estimator.estimate(
                    scene.features, thermal, views, scene.origin_px, evidence
                )
        except DegenerateHomographyError as error:
            raise UnmatchableFrameError(Reason.DEGENERATE_HOMOGRAPHY, error) from error
        members_px = [member.corners_px(scene, views[:1]) for member in self._members]
        return FrameMatch(scene, views, estimate, np.array(members_px).reshape(-1, 4, 2))

    def corners_px(self, scene: Scene, views_px: FloatArray) -> FloatArray:
        """Return where this matcher's network finds views ``(N, 4, 2)`` of another's scene.

        Without a homography they are where the prior has them, as a crop without one is: a network
        that found nothing must not cost the frame what the others found.
        """
        with self._timer.stage("map"):
            features = self._tiles.read(scene.features.box)
        try:
            with self._timer.stage("search"):
                return self.estimator.estimate(
                    features, scene.thermal, views_px, scene.origin_px
                ).corners_px
        except DegenerateHomographyError as error:
            _log.debug("a member of the ensemble answers with the log's place: %s", error)
            return views_px + scene.origin_px

    def evidence(
        self, prior: Prior, image: ImageArray, radius_m: float, scene: Scene
    ) -> FloatArray | None:
        """Return what this matcher says of every shift ``(rows, columns)`` of another's scene.

        ``image`` is the frame, decoded. None where it says nothing.
        """
        try:
            match = self._match(prior, image, CropTtaConfig(views=1), radius_m)
        except UnmatchableFrameError as error:
            _log.debug("%s at %.2f m/px: %s", prior.frame.name, self.grid.gsd_m, error)
            return None
        if match.estimate.scores is None:
            return None
        return scores_elsewhere(
            match.estimate.scores, match.scene.placement, scene.placement, scene.shifts
        )

    def scene(self, prior: Prior, radius_m: float, ground: Ground | None = None) -> Scene:
        """Return a frame, rectified, and the map within ``radius_m`` of where it may lie.

        ``ground`` as in :meth:`match`.

        Raises:
            UnmatchableFrameError: it cannot be read or rectified, or the map has nothing there.
        """
        return self._scene(prior, self._decoded(prior), radius_m, ground)

    def _scene(
        self, prior: Prior, image: ImageArray, radius_m: float, ground: Ground | None
    ) -> Scene:
        camera, thermal = self._rectified(prior, image, ground)
        nadir_m = self.local.to_metres(np.array([prior.lat_deg, prior.lon_deg]))
        ortho_origin_px = metres_to_grid(self.grid, nadir_m) - thermal.nadir_px
        features = self._read_window(thermal, ortho_origin_px, radius_m)
        if not features.valid.any():
            raise UnmatchableFrameError(Reason.OFF_MAP, "the search window has no map data")
        return Scene(camera, thermal, features, ortho_origin_px - box_origin(features.box))

    def _decoded(self, prior: Prior) -> ImageArray:
        try:
            with self._timer.stage("decode"):
                image = read_frame(prior.frame.path)
        except UnreadableFrameError as error:
            raise UnmatchableFrameError(Reason.UNREADABLE, error) from error
        return np.ascontiguousarray(image[:, ::-1]) if self._mirrored else image

    def _rectified(
        self, prior: Prior, image: ImageArray, ground: Ground | None
    ) -> tuple[CameraModel, Ortho]:
        try:
            height_px, width_px = image.shape
            camera = self._camera.model_of_frame(prior.frame.path, width_px, height_px)
            over = None if ground is None else ground.over(camera, prior)
            with self._timer.stage("rectify"):
                return camera, rectify(
                    image, camera, prior, self.grid.gsd_m, multiple_px=_ALIGNMENT_PX, over=over
                )
        except UnreadableFrameError as error:
            raise UnmatchableFrameError(Reason.UNREADABLE, error) from error
        except ObliqueFrameError as error:
            raise UnmatchableFrameError(Reason.TOO_OBLIQUE, error) from error
        except FootprintSizeError as error:
            raise UnmatchableFrameError(Reason.NO_PRIOR, error) from error
        except TexturelessFrameError as error:
            raise UnmatchableFrameError(Reason.TEXTURELESS, error) from error
        except DegenerateHomographyError as error:
            raise UnmatchableFrameError(Reason.DEGENERATE_HOMOGRAPHY, error) from error

    def _read_window(
        self, thermal: Ortho, ortho_origin_px: FloatArray, radius_m: float
    ) -> MapFeatures:
        """Return map features of the ortho's box grown by the radius."""
        height_px, width_px = thermal.image.shape
        reach_px = 2 * radius_m / thermal.gsd_m
        centre_px = ortho_origin_px + (np.array([width_px, height_px]) - 1) / 2
        box = aligned_box(
            (float(centre_px[0]), float(centre_px[1])),
            width_px + reach_px,
            height_px + reach_px,
            _ALIGNMENT_PX,
        )
        with self._timer.stage("map"):
            return self._tiles.read(box)
