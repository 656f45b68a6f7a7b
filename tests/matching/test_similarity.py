"""Features that are turned and enlarged lie where the convention says."""

import math

import numpy as np

from uasthn_cli.matching.similarity import turned_features
from uasthn_cli.seam import Similarity
from uasthn_cli.types import ImageArray

ROWS, COLUMNS = 41, 57


def spot(right: int, down: int) -> ImageArray:
    """Return features ``(1, h, w)`` with one bright cell off the middle."""
    features = np.zeros((1, ROWS, COLUMNS), np.float32)
    features[0, ROWS // 2 + down, COLUMNS // 2 + right] = 1.0
    return features


def place_of(image: ImageArray) -> tuple[float, float]:
    """Return the centre of mass, right of and below the middle."""
    rows, columns = np.mgrid[:ROWS, :COLUMNS]
    weights = image
    total = weights.sum()
    right = float((weights * columns).sum() / total) - (COLUMNS - 1) / 2
    return right, float((weights * rows).sum() / total) - (ROWS - 1) / 2


def test_convention_clockwise_takes_right_to_down() -> None:
    mask = np.ones((ROWS, COLUMNS), np.float32)
    turn = Similarity(yaw_rad=math.radians(30.0))
    turned, _ = turned_features(spot(12, 0), mask, [turn])
    right, down = place_of(turned[0, 0])
    np.testing.assert_allclose((right, down), (12 * math.cos(math.pi / 6), 6.0), atol=0.1)


def test_convention_a_larger_scale_takes_outward() -> None:
    mask = np.ones((ROWS, COLUMNS), np.float32)
    turned, _ = turned_features(spot(10, -8), mask, [Similarity(scale=1.25)])
    np.testing.assert_allclose(place_of(turned[0, 0]), (12.5, -10.0), atol=0.1)


def test_the_mask_turns_along_and_each_hypothesis_has_its_own() -> None:
    mask = np.zeros((ROWS, COLUMNS), np.float32)
    mask[10:31, 8:49] = 1.0
    hypotheses = [Similarity(), Similarity(yaw_rad=math.pi / 2), Similarity(scale=0.5)]
    turned, masks = turned_features(
        np.random.default_rng(0).random((3, ROWS, COLUMNS), np.float32), mask, hypotheses
    )
    assert turned.shape == (3, 3, ROWS, COLUMNS)
    upright, quarter, half = masks
    assert np.ptp(np.nonzero(upright)[1]) > np.ptp(np.nonzero(upright)[0])
    assert np.ptp(np.nonzero(quarter)[0]) >= np.ptp(np.nonzero(quarter)[1])
    assert 0.2 < half.sum() / upright.sum() < 0.3
