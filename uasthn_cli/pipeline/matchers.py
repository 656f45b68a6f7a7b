"""Build the matchers of a run: choose their map grids, open the maps, load the networks."""

import logging
import math
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uasthn_cli.config import (
    GSD_STEP,
    MAX_MAP_ENLARGEMENT,
    ORIGIN_STEP_DEG,
    REFINE_WIDTH_PX,
    THERMAL_WIDTH_PX,
)
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.ingest.frames import UnreadableFrameError, frame_size_px
from uasthn_cli.mapping.content import content_sha256
from uasthn_cli.mapping.feature_store import open_store
from uasthn_cli.mapping.reader import MapReader
from uasthn_cli.mapping.tiles import EncodingCache, FeatureTiles
from uasthn_cli.pipeline.estimators import open_base, open_members
from uasthn_cli.pipeline.frame_matcher import FrameMatcher
from uasthn_cli.pipeline.job import GeotagJob
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.seam import CacheableEncoder, Estimator
from uasthn_cli.types import CameraModel, FloatArray, Prior

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MatcherBuilder:
    """What the matchers of a run share; ``maps`` closes the maps that are opened for them."""

    job: GeotagJob
    local: LocalFrame
    timer: StageTimer
    maps: ExitStack

    def open_map(self, gsd_m: float) -> MapReader:
        """Open the map on a grid of ``gsd_m``."""
        return self.maps.enter_context(MapReader(self.job.map_path, self.local, gsd_m))

    @cached_property
    def _map_sha256(self) -> str | None:
        return content_sha256(self.job.map_path)

    def tiles(self, reader: MapReader, estimator: Estimator) -> FeatureTiles:
        """Return a map's features as an estimator's network has them."""
        cache = None
        if self.job.cache_dir is not None and isinstance(estimator, CacheableEncoder):
            store = open_store(self.job.cache_dir)
            content = self._map_sha256
            map_id = None if content is None else reader.windows_id(content)
            cache = EncodingCache(store, estimator, reader.grid, map_id)
        return FeatureTiles(
            self.timer.timed("map", reader.read),
            self.timer.timed("features", estimator.encode_map),
            stride_px=estimator.stride_px,
            halo_px=estimator.halo_px,
            cache=cache,
        )

    def matcher(
        self,
        reader: MapReader,
        estimator: Estimator,
        tiles: FeatureTiles,
        *,
        second: FrameMatcher | None = None,
        members: tuple[FrameMatcher, ...] = (),
    ) -> FrameMatcher:
        """Return a matcher on a map's grid, alone or with others as :class:`FrameMatcher` says."""
        return FrameMatcher(
            self.job.camera,
            reader.grid,
            tiles,
            estimator,
            self.local,
            self.timer,
            second=second,
            members=members,
        )

    def second_scale(self, search_gsd_m: float) -> FrameMatcher | None:
        """Return the matcher at the estimator's second scale; None where it has but one.

        Raises:
            WeightsError: the weights cannot be used.
        """
        scale = self.job.spec.second_scale
        if scale is None:
            return None
        reader = self.open_map(scale * search_gsd_m)
        estimator = open_base(self.job, symmetries=1, second_scale=True)
        return self.matcher(reader, estimator, self.tiles(reader, estimator))

    def members(self, reader: MapReader) -> tuple[FrameMatcher, ...]:
        """Return the matchers of an ensemble's further networks.

        Raises:
            WeightsError: the weights cannot be used.
        """
        return tuple(
            self.matcher(reader, member, self.tiles(reader, member))
            for member in open_members(self.job)
        )


def choose_gsds_m(job: GeotagJob, priors: list[Prior], native_m: float) -> tuple[float, float]:
    """Return the GSD of the search and of the refinement.

    Each is a power of ``GSD_STEP``, or a share of the map's own pixels where these are coarser.
    The search sees a frame about 96 px wide, at most twice as fine as the map's own pixels
    (enlarging a coarse map helps: features come at half the image's resolution); the refinement
    256 px wide, at most as fine as the map.
    """
    camera = first_camera(job, priors)
    height_m = float(np.median([prior.height_above_ground_m for prior in priors]))
    footprint_m = height_m * camera.width_px / camera.focal_x_px
    search_m = max(native_m / MAX_MAP_ENLARGEMENT, _shared_gsd_m(footprint_m / THERMAL_WIDTH_PX))
    refine_m = max(native_m, _shared_gsd_m(footprint_m / REFINE_WIDTH_PX))
    return job.config.gsd_m or search_m, refine_m


def shared_frame(positions_deg: FloatArray) -> LocalFrame:
    """Return the local frame of a flight's area: other flights there see the map on the same grid.

    What one of them kept of the map is then of use to the next.
    """
    latitude, longitude = np.median(positions_deg, axis=0) / ORIGIN_STEP_DEG
    return LocalFrame(round(latitude) * ORIGIN_STEP_DEG, round(longitude) * ORIGIN_STEP_DEG)


def _shared_gsd_m(gsd_m: float) -> float:
    """Return the nearest resolution that flights of about the same height share."""
    return float(GSD_STEP ** round(math.log(gsd_m, GSD_STEP)))


def first_camera(job: GeotagJob, priors: list[Prior]) -> CameraModel:
    """Return the camera of the first frame that can be read."""
    for prior in priors:
        try:
            return job.camera.model_of_frame(prior.frame.path, *frame_size_px(prior.frame.path))
        except UnreadableFrameError as error:
            _log.debug("%s: %s", prior.frame.name, error)
    return job.camera.model(640, 512)
