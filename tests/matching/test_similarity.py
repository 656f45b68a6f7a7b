"""A frame that is turned and of another scale is seen to be so."""

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates
from torch import Tensor

from uasthn_cli.matching.similarity import fit_similarity, paraboloid_peak
from uasthn_cli.types import FloatArray

ROWS, COLUMNS = 40, 56
MARGIN = 30


def field(seed: int) -> FloatArray:
    """Return a map's features ``(3, h, w)``, of structure at two scales, larger than a frame."""
    random = np.random.default_rng(seed)
    shape = (ROWS + 2 * MARGIN, COLUMNS + 2 * MARGIN)
    layers = []
    for _ in range(3):
        noise = [random.standard_normal(shape) for _ in range(2)]
        blurred = [cv2.GaussianBlur(n, (0, 0), s) for n, s in zip(noise, (1.5, 4.0), strict=True)]
        layers.append(sum(layer / layer.std() for layer in blurred))
    return np.array(layers)


def seen_turned(ground: FloatArray, yaw_deg: float, scale: float) -> FloatArray:
    """Return the frame ``(3, h, w)`` whose content lies turned clockwise and enlarged on the map.

    What it shows at an offset from its middle lies on the map at that offset, turned and enlarged:
    columns go right and rows down, so that clockwise takes right to down.
    """
    rows, columns = np.mgrid[:ROWS, :COLUMNS].astype(float)
    down, right = rows - (ROWS - 1) / 2, columns - (COLUMNS - 1) / 2
    cosine, sine = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    map_right = scale * (cosine * right - sine * down)
    map_down = scale * (sine * right + cosine * down)
    middle_row, middle_column = ((side - 1) / 2 for side in ground.shape[1:])
    places = [map_down + middle_row, map_right + middle_column]
    return np.array([map_coordinates(layer, places, order=3) for layer in ground])


def likeness(ground: FloatArray) -> Callable[[Tensor, Tensor], Tensor]:
    """Return the score of hypotheses: their normalised correlation with the map's middle."""
    middle = torch.from_numpy(ground[:, MARGIN:-MARGIN, MARGIN:-MARGIN]).float()

    def score(turned: Tensor, masks: Tensor) -> Tensor:
        both = (turned * middle * masks).flatten(1).sum(dim=1)
        norms = [(part**2 * masks).flatten(1).sum(dim=1).sqrt() for part in (turned, middle)]
        return both / (norms[0] * norms[1])

    return score


def fitted(seed: int, yaw_deg: float, scale: float) -> tuple[float, float] | None:
    """Return turn in degrees and scale."""
    ground = field(seed)
    frame = torch.from_numpy(seen_turned(ground, yaw_deg, scale)).float()
    found = fit_similarity(likeness(ground), frame, torch.ones(1, ROWS, COLUMNS))
    return None if found is None else (math.degrees(found.yaw_rad), found.scale)


@settings(max_examples=25)
@given(yaw_deg=st.floats(-7.0, 7.0), scale=st.floats(0.92, 1.08), seed=st.integers(0, 3))
def test_convention_a_known_turn_and_scale_come_back_clockwise_positive(
    yaw_deg: float, scale: float, seed: int
) -> None:
    found = fitted(seed, yaw_deg, scale)
    assert found is not None
    assert found[0] == pytest.approx(yaw_deg, abs=0.1)
    assert found[1] == pytest.approx(scale, abs=0.002)


@pytest.mark.parametrize(
    ("yaw_deg", "scale"), [(12.0, 1.0), (-40.0, 1.0), (0.0, 1.2), (0.0, 0.85), (90.0, 1.0)]
)
def test_what_no_log_gets_wrong_fits_nothing(yaw_deg: float, scale: float) -> None:
    assert fitted(0, yaw_deg, scale) is None


def test_what_the_frame_does_not_show_has_no_influence() -> None:
    ground = field(1)
    frame = seen_turned(ground, 3.0, 1.02)
    mask = torch.ones(1, ROWS, COLUMNS)
    mask[:, :8], mask[:, :, 45:] = 0.0, 0.0
    soiled = torch.from_numpy(frame).float() * mask + 50.0 * (1 - mask)
    clean = torch.from_numpy(frame).float() * mask
    for shown in (clean, soiled):
        found = fit_similarity(likeness(ground), shown, mask)
        assert found is not None
        assert math.degrees(found.yaw_rad) == pytest.approx(3.0, abs=0.1)
        assert found.scale == pytest.approx(1.02, abs=0.002)


def test_a_score_that_only_rises_has_no_top() -> None:
    frame = torch.from_numpy(seen_turned(field(0), 0.0, 1.0)).float()

    def rising(turned: Tensor, masks: Tensor) -> Tensor:
        return torch.arange(len(turned), dtype=torch.float32)

    assert fit_similarity(rising, frame, torch.ones(1, ROWS, COLUMNS)) is None


GRID = torch.cartesian_prod(*[torch.tensor([-1.0, 0.0, 1.0], dtype=torch.float64)] * 2)


@given(
    top=st.tuples(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9)),
    bends=st.tuples(st.floats(0.5, 5.0), st.floats(0.5, 5.0)),
    twist=st.floats(-0.4, 0.4),
)
def test_the_top_of_a_paraboloid_is_found_exactly(
    top: tuple[float, float], bends: tuple[float, float], twist: float
) -> None:
    x, y = GRID[:, 0] - top[0], GRID[:, 1] - top[1]
    scores = 7.0 - bends[0] * x**2 - bends[1] * y**2 - twist * x * y
    best = GRID[int(scores.argmax())]
    found = paraboloid_peak(GRID, scores)
    within_a_step = max(abs(float(best[k]) - top[k]) for k in range(2)) <= 1.0
    expected = top if within_a_step else (float(best[0]), float(best[1]))
    assert found == pytest.approx(expected, abs=1e-6)


def test_without_a_top_the_best_hypothesis_is_the_answer() -> None:
    saddle = GRID[:, 0] ** 2 - 2 * GRID[:, 1] ** 2 + 0.1 * GRID[:, 0]
    assert paraboloid_peak(GRID, saddle) == (1.0, 0.0)
    plane = GRID[:, 0] - 2 * GRID[:, 1]
    assert paraboloid_peak(GRID, plane) == (1.0, -1.0)
