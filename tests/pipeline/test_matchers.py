"""Which map grids a run matches on, and what its matchers share."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from posed_flight import Pose, PosedFlight, make_posed_flight, opened

from uasthn_cli.config import ORIGIN_STEP_DEG
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.pipeline import GeotagJob
from uasthn_cli.pipeline.matchers import MatcherBuilder, shared_frame
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.types import Prior


def test_flights_of_one_area_share_the_maps_grid(tmp_path: Path) -> None:
    described = []
    for number, height_m in enumerate((95.0, 95.8)):
        poses = (Pose(190.0 + 15 * number, 200.0, height_m=height_m),)
        with opened(make_posed_flight(tmp_path / str(number), poses)) as run:
            described.append(run.describe())
    for name in ("map_gsd_m", "refine_map_gsd_m", "local_origin"):
        assert described[0][name] == described[1][name]


def test_an_areas_frame_is_centred_on_round_degrees() -> None:
    local = shared_frame(np.array([(24.013, 54.49), (24.031, 54.51), (24.022, 54.53)]))
    assert (local.lat_deg, local.lon_deg) == pytest.approx((24.0, 54.5))
    assert local.lat_deg / ORIGIN_STEP_DEG == pytest.approx(round(local.lat_deg / ORIGIN_STEP_DEG))


def test_a_matcher_is_built_on_its_maps_grid_with_its_members(flight: PosedFlight) -> None:
    with opened(flight) as run:
        prior = next(entry for entry in run.priors.results if isinstance(entry, Prior))
    local = LocalFrame(prior.lat_deg, prior.lon_deg)
    job = GeotagJob(flight.log, flight.frames, flight.map, CameraSpec(hfov_deg=45.0))
    with ExitStack() as maps:
        build = MatcherBuilder(job, local, StageTimer(), maps)
        reader, estimator = build.open_map(1.5), NccEstimator()
        matcher = build.matcher(reader, estimator, build.tiles(reader, estimator))
        assert (matcher.grid.gsd_m, matcher.pitch_m, matcher.members) == (1.5, 1.5, 1)
        both = build.matcher(
            reader, estimator, build.tiles(reader, estimator), members=(matcher, matcher)
        )
        assert both.members == 3
