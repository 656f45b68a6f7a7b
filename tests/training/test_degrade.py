"""What cameras and time do to images: within bounds, masked, the input untouched."""

import numpy as np
import pytest
from tiny_training import pattern

from uasthn_cli.training.degrade import degrade_map, degrade_thermal, map_edge
from uasthn_cli.training.engine import EngineConfig

THERMAL = pattern(1, 96, 112)
RGB = np.stack([pattern(seed, 60, 80) for seed in (1, 2, 3)], axis=-1)
VALID = np.zeros((96, 112), np.float32)
VALID[10:80, 20:100] = 1


@pytest.mark.parametrize("seed", range(20))
def test_thermal_is_masked_finite_and_still_what_it_was(seed: int) -> None:
    given = THERMAL.copy()
    degraded = degrade_thermal(np.random.default_rng(seed), given, VALID, EngineConfig())
    assert np.array_equal(given, THERMAL), "the other canvases are cut from the same field"
    assert degraded.dtype == np.float32
    assert (degraded[VALID == 0] == 0).all()
    assert np.isfinite(degraded).all()
    seen = VALID > 0
    assert abs(np.asarray(np.corrcoef(degraded[seen], THERMAL[seen]))[0, 1]) > 0.3


def test_thermal_without_any_contrast_stays_finite() -> None:
    flat = np.full((96, 112), 0.5, np.float32)
    for seed in range(10):
        assert np.isfinite(
            degrade_thermal(np.random.default_rng(seed), flat, VALID, EngineConfig())
        ).all()


@pytest.mark.parametrize("seed", range(20))
def test_map_stays_a_colour_image(seed: int) -> None:
    given = RGB.copy()
    degraded = degrade_map(np.random.default_rng(seed), given, EngineConfig())
    assert np.array_equal(given, RGB)
    assert degraded.shape == RGB.shape
    assert degraded.dtype == np.float32
    assert degraded.min() >= 0
    assert degraded.max() <= 1


def test_the_same_generator_degrades_alike() -> None:
    first, second = (
        degrade_thermal(np.random.default_rng(3), THERMAL, VALID, EngineConfig()) for _ in range(2)
    )
    assert np.array_equal(first, second)


def test_without_a_sensor_the_scene_is_seen_as_it_is() -> None:
    engine = EngineConfig(sensor=False)
    for seed in range(5):
        seen = degrade_thermal(np.random.default_rng(seed), THERMAL, VALID, engine)[VALID > 0]
        expected = ((THERMAL - THERMAL.mean()) / THERMAL.std())[VALID > 0]
        assert seen == pytest.approx(expected, abs=1e-4)


def test_without_map_appearance_the_map_is_as_it_is() -> None:
    engine = EngineConfig(map_appearance=False)
    for seed in range(5):
        assert np.array_equal(degrade_map(np.random.default_rng(seed), RGB, engine), RGB)


def test_map_edges_are_rare_straight_and_on_all_four_sides() -> None:
    rng = np.random.default_rng(0)
    edges = [map_edge(rng, 64) for _ in range(400)]
    cut = [edge for edge in edges if (edge == 0).any()]
    assert 0.08 < len(cut) / len(edges) < 0.22
    sides = set()
    for edge in cut:
        rows, columns = edge.max(axis=1), edge.max(axis=0)
        assert np.array_equal(edge, rows[:, None] * columns), "a straight edge"
        assert 0.55 < edge.mean() < 0.97
        sides.add((rows[0], rows[-1], columns[0], columns[-1]))
    assert len(sides) == 4
