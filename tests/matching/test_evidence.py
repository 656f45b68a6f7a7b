"""What else is known of a frame's place counts beside what an estimator sees itself."""

import numpy as np
import pytest
from known_model import known_encoders
from matching_scene import centred_origin, encoded, full_view, map_window, thermal_cut
from small_flight import ground_texture

from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.matching.xcorr import XcorrEstimator
from uasthn_cli.seam import Estimator

TILE = ground_texture(8)[:240, :144]
TWINS = np.concatenate([TILE, TILE], axis=1)
CORNER_PX, SIZE_PX = (48, 90), (48, 48)


@pytest.mark.parametrize(
    "estimator",
    [NccEstimator(), XcorrEstimator(known_encoders(), symmetries=1)],
    ids=["ncc", "xcorr"],
)
@pytest.mark.parametrize("twin", [0, 1])
def test_evidence_decides_between_places_that_look_alike(estimator: Estimator, twin: int) -> None:
    window, thermal = map_window(TWINS), thermal_cut(TWINS, CORNER_PX, SIZE_PX)
    features, views = encoded(estimator, window), full_view(thermal)
    origin_px = centred_origin(window, thermal)
    free = estimator.estimate(features, thermal, views, origin_px)
    assert free.scores is not None
    assert free.confidence < 0.6
    columns = np.arange(free.scores.shape[1]) * features.stride_px
    right_one = (columns >= 120) == bool(twin)
    evidence = np.broadcast_to(np.where(right_one, 0.0, -30.0), free.scores.shape)
    told = estimator.estimate(features, thermal, views, origin_px, evidence)
    assert told.corners_px[0, 0] == pytest.approx(
        np.add(CORNER_PX, [twin * TILE.shape[1], 0]), abs=0.6
    )
    assert told.confidence > 1.3 * free.confidence
    assert told.scores == pytest.approx(free.scores + evidence)
