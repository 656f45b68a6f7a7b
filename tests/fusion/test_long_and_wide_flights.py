"""What a flight takes grows neither with its length nor with the errors of its log."""

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest

from uasthn_cli.fusion.diffusion import fit_diffusion
from uasthn_cli.fusion.forward_backward import smooth
from uasthn_cli.fusion.offsets import OffsetGrid, best_offset_m, cell_offsets_m, grid_of_radius
from uasthn_cli.fusion.spool import LikelihoodSpool
from uasthn_cli.types import FloatArray, OffsetLikelihood

STEP_S = 2.0
AT_LOG = np.zeros(2)


def walk_m(count: int, start_m: tuple[float, float], diffusion: float = 3.0) -> FloatArray:
    """Return an error ``(T, 2)`` of the log that wanders."""
    steps = np.random.default_rng(1).normal(0.0, diffusion * STEP_S**0.5, (count, 2))
    return np.asarray(np.array(start_m) + steps.cumsum(axis=0))


def frames_that_see(places_m: FloatArray, grid: OffsetGrid) -> Iterator[OffsetLikelihood]:
    """Yield likelihoods with a hill at the truth and two equal ones anywhere else."""
    random = np.random.default_rng(2)
    east, north = cell_offsets_m(grid.size, grid.cell_m, AT_LOG)
    reach_m = grid.half * grid.cell_m
    for place_m in places_m:
        elsewhere = random.uniform(-0.7 * reach_m, 0.7 * reach_m, (2, 2))
        log = np.full((grid.size, grid.size), -12.0)
        for x, y in (place_m + random.normal(0.0, 5.0, 2), *elsewhere):
            width_m = max(8.0, 0.6 * grid.cell_m)
            log = np.maximum(log, -0.5 * ((east - x) ** 2 + (north - y) ** 2) / width_m**2)
        yield OffsetLikelihood.of(log - log.max(), grid.cell_m, AT_LOG)


def settled_m(likelihoods: LikelihoodSpool, cell_m: float) -> FloatArray:
    """Return where the flight settles ``(T, 2)``."""
    times_s = STEP_S * np.arange(float(len(likelihoods)))
    diffusion = fit_diffusion(likelihoods, times_s, speed_m_s=30.0)
    posteriors = smooth(likelihoods, times_s, diffusion).posteriors
    return np.array([best_offset_m(entry, cell_m, AT_LOG) for entry in posteriors])


@pytest.mark.parametrize(
    ("radius_m", "start_m"), [(2000.0, (1100.0, -1020.0)), (1000.0, (-600.0, 500.0))]
)
def test_a_flight_is_found_however_far_its_log_is_off(
    radius_m: float, start_m: tuple[float, float]
) -> None:
    """A frame alone sees three places alike, on a grid whose cells are 20 m or 10 m."""
    grid = grid_of_radius(radius_m, 4.0)
    assert grid.cell_m == radius_m / 100
    truth_m = walk_m(40, start_m)
    found_m = settled_m(LikelihoodSpool(frames_that_see(truth_m, grid)), grid.cell_m)
    apart_m = np.linalg.norm(found_m - truth_m, axis=1)
    assert apart_m.mean() < grid.cell_m
    assert apart_m.max() < 1.5 * grid.cell_m


def peak_bytes(count: int, grid: OffsetGrid) -> int:
    """Return the most memory that settling a flight took."""
    truth_m = walk_m(count, (0.0, 0.0), diffusion=0.5)
    tracemalloc.start()
    try:
        settled_m(LikelihoodSpool(frames_that_see(truth_m, grid)), grid.cell_m)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_frames() -> None:
    grid = grid_of_radius(200.0, 5.0)
    few, many = peak_bytes(20, grid), peak_bytes(200, grid)
    assert many - few < 180 * 1000, "a frame keeps less than a kilobyte, not a grid"
