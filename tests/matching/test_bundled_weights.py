"""The weights in the box find rendered night views in rendered maps."""

from pathlib import Path

import numpy as np
import pytest
from matching_scene import GSD_M, centred_origin, encoded, full_view, thermal_cut

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.matching.registry import XCORR
from uasthn_cli.matching.weights import read_xcorr
from uasthn_cli.matching.xcorr import XcorrEstimator, open_xcorr
from uasthn_cli.synth.landscape import LandscapeKind, render_landscape
from uasthn_cli.types import GridBox, MapGrid, MapStatistics, MapWindow

WIDTH_PX, HEIGHT_PX = 288, 256
CORNER_PX, SIZE_PX = (130, 60), (96, 80)


@pytest.fixture(scope="module")
def estimator() -> XcorrEstimator:
    return open_xcorr(XCORR.bundled_weights[:1], "cpu", 1)


@pytest.mark.parametrize("kind", [LandscapeKind.FARMS, LandscapeKind.DUNES])
def test_a_rendered_night_view_is_found(kind: LandscapeKind, estimator: XcorrEstimator) -> None:
    place = render_landscape(1, (WIDTH_PX, HEIGHT_PX), GSD_M, kind=kind)
    rgb = (place.rgb / 255.0).astype(np.float32)
    red, green, blue = (float(mean) for mean in rgb.mean(axis=(0, 1)))
    window = MapWindow(
        image=rgb,
        valid=np.ones(rgb.shape[:2], np.bool_),
        box=GridBox(0, 0, WIDTH_PX, HEIGHT_PX),
        grid=MapGrid(GSD_M),
        statistics=MapStatistics((red, green, blue), float(rgb.std(axis=(0, 1)).mean())),
    )
    low, high = np.percentile(place.temperature, (1, 99))
    grey = 255.0 * np.clip((place.temperature - low) / (high - low), 0.0, 1.0)
    thermal = thermal_cut(grey, CORNER_PX, SIZE_PX)
    estimate = estimator.estimate(
        encoded(estimator, window), thermal, full_view(thermal), centred_origin(window, thermal)
    )
    errors_px = estimate.corners_px[0] - (full_view(thermal)[0] + CORNER_PX)
    assert np.linalg.norm(errors_px, axis=1).max() * GSD_M < TOLERANCE_M
    assert estimate.confidence > 0.5


@pytest.mark.parametrize("path", XCORR.bundled_weights, ids=lambda path: path.stem)
def test_the_weights_say_how_they_came_about(path: Path) -> None:
    if not path.is_file():
        pytest.skip(f"{path.name} is not in the box")
    assert set(read_xcorr(path).notes) > {"format", "architecture"}
