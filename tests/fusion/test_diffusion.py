"""How fast an error wanders is read off the flight itself."""

import numpy as np
import pytest

from uasthn_cli.fusion.diffusion import (
    CANDIDATES_M_PER_SQRT_S,
    DEFAULT_M_PER_SQRT_S,
    fit_diffusion,
)
from uasthn_cli.types import FloatArray, OffsetLikelihood

CELL_M, SIZE = 3.0, 81
SIGMA_M = 5.0
STEP_S = 2.0


def seen(offset_m: FloatArray) -> OffsetLikelihood:
    """Return a likelihood around an offset."""
    steps = (np.arange(SIZE) - SIZE // 2) * CELL_M
    squared = (steps[None, :] - offset_m[0]) ** 2 + (-steps[:, None] - offset_m[1]) ** 2
    values = -0.5 * squared / SIGMA_M**2
    return OffsetLikelihood.of(values - values.max(), CELL_M, np.zeros(2))


def wandering(diffusion: float, count: int = 60, seed: int = 0) -> list[OffsetLikelihood]:
    """Return frames of a random walk, each seen with noise of ``SIGMA_M`` per axis."""
    rng = np.random.default_rng(seed)
    walk = rng.normal(0.0, diffusion * np.sqrt(STEP_S), (count, 2)).cumsum(axis=0)
    walk -= (walk.max(axis=0) + walk.min(axis=0)) / 2
    return [seen(place) for place in walk + rng.normal(0.0, SIGMA_M, walk.shape)]


def times_s(count: int) -> FloatArray:
    return STEP_S * np.arange(float(count))


@pytest.mark.parametrize("diffusion", [1.5, 4.0, 8.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_diffusion_of_a_random_walk_is_found_to_a_factor_of_two(
    diffusion: float, seed: int
) -> None:
    found = fit_diffusion(wandering(diffusion, seed=seed), times_s(60), speed_m_s=30.0)
    assert diffusion / 2 <= found <= diffusion * 2


def test_an_error_cannot_outrun_the_aircraft() -> None:
    frames = wandering(12.0)
    fast = fit_diffusion(frames, times_s(60), speed_m_s=30.0)
    slow = fit_diffusion(frames, times_s(60), speed_m_s=3.0)
    assert fast > 8.0
    assert slow <= 3.0 * np.sqrt(STEP_S)
    hovering = fit_diffusion(frames, times_s(60), speed_m_s=0.0)
    assert hovering == CANDIDATES_M_PER_SQRT_S[0]


def test_only_a_wide_search_expects_an_error_that_wanders_fast() -> None:
    frames = wandering(30.0)
    usual = fit_diffusion(frames, times_s(60), speed_m_s=100.0, radius_m=200.0)
    wide = fit_diffusion(frames, times_s(60), speed_m_s=100.0, radius_m=2000.0)
    assert usual <= 16.0 < wide


def test_too_few_frames_get_the_default() -> None:
    few: list[OffsetLikelihood | None] = [seen(np.zeros(2)), None, seen(np.zeros(2)), None]
    assert fit_diffusion(few, times_s(4), speed_m_s=30.0) == DEFAULT_M_PER_SQRT_S
    at_once = [seen(np.zeros(2))] * 4
    assert fit_diffusion(at_once, np.zeros(4), speed_m_s=30.0) == DEFAULT_M_PER_SQRT_S
