"""A flight's posteriors against a direct sum over all paths, and what a flight must do."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest

from uasthn_cli.fusion.forward_backward import OUTLIER_SHARE, log_evidence, smooth
from uasthn_cli.fusion.offsets import best_offset_m
from uasthn_cli.types import FloatArray, OffsetLikelihood

SIZE = 41
CELL_M = 2.0
Likelihoods = Sequence[OffsetLikelihood | None]


def likelihood(
    log_likelihood: FloatArray, cell_m: float = CELL_M, centre_m: tuple[float, float] = (0.0, 0.0)
) -> OffsetLikelihood:
    """Return a likelihood from values whose largest becomes 0."""
    return OffsetLikelihood.of(log_likelihood - log_likelihood.max(), cell_m, np.array(centre_m))


def hill(
    east_m: float,
    north_m: float,
    sigma_m: float = 4.0,
    centre_m: tuple[float, float] = (0.0, 0.0),
    size: int = SIZE,
) -> OffsetLikelihood:
    """Return a normal likelihood around an offset."""
    steps = (np.arange(size) - size // 2) * CELL_M
    east = centre_m[0] + steps[None, :] - east_m
    north = centre_m[1] - steps[:, None] - north_m
    return likelihood(-0.5 * (east**2 + north**2) / sigma_m**2, centre_m=centre_m)


def answers_m(
    likelihoods: Likelihoods,
    times_s: FloatArray,
    diffusion: float,
    centres_m: Sequence[tuple[float, float]] | None = None,
) -> FloatArray:
    """Return the best offset of every frame ``(T, 2)``."""
    posteriors = smooth(likelihoods, times_s, diffusion).posteriors
    centres = centres_m or [(0.0, 0.0)] * len(posteriors)
    return np.array(
        [best_offset_m(p, CELL_M, np.array(c)) for p, c in zip(posteriors, centres, strict=True)]
    )


def reflected_step(size: int, sigma: float) -> FloatArray:
    """Return ``(size, size)``: the chance to wander from one cell to another, walls reflecting."""
    kernel_half = max(1, round(4 * sigma) + 1)
    steps = np.arange(-kernel_half, kernel_half + 1)
    weights = np.exp(-0.5 * (steps / sigma) ** 2)
    weights /= weights.sum()
    matrix = np.zeros((size, size))
    for start, (step, weight) in itertools.product(range(size), zip(steps, weights, strict=True)):
        place = (start + step) % (2 * size)
        matrix[start, place if place < size else 2 * size - 1 - place] += weight
    return matrix


def brute_force(
    likelihoods: Likelihoods, times_s: FloatArray, diffusion: float
) -> tuple[FloatArray, float]:
    """Return posteriors and log evidence by summing over every path through a tiny grid."""
    known = next(entry for entry in likelihoods if entry is not None)
    size = len(known.log_likelihood)
    cells = size * size
    emissions = []
    for entry in likelihoods:
        seen = np.ones(cells)
        if entry is not None:
            weights = np.exp(entry.log_likelihood.astype(np.float64)).ravel()
            seen = (1 - OUTLIER_SHARE) * weights * cells / weights.sum() + OUTLIER_SHARE
        emissions.append(seen)
    steps = []
    for elapsed_s in np.diff(times_s):
        along = reflected_step(size, diffusion * math.sqrt(elapsed_s) / known.cell_m)
        steps.append(np.kron(along, along))
    mass = np.zeros((len(emissions), cells))
    total = 0.0
    for path in itertools.product(range(cells), repeat=len(emissions)):
        weight = 1.0 / cells
        for index, cell in enumerate(path):
            weight *= emissions[index][cell]
            if index:
                weight *= steps[index - 1][path[index - 1], cell]
        total += weight
        mass[np.arange(len(path)), path] += weight
    return (mass / total).reshape(-1, size, size), math.log(total)


@pytest.mark.parametrize("silent", [None, 0, 1, 2])
def test_posteriors_and_evidence_are_those_of_a_sum_over_all_paths(silent: int | None) -> None:
    rng = np.random.default_rng(3)
    likelihoods: list[OffsetLikelihood | None] = [
        likelihood(rng.normal(0.0, 2.0, (3, 3))) for _ in range(4)
    ]
    if silent is not None:
        likelihoods[silent] = None
    times_s = np.array([0.0, 1.0, 1.5, 3.5])
    diffusion = 1.4
    expected, evidence = brute_force(likelihoods, times_s, diffusion)
    found = smooth(likelihoods, times_s, diffusion)
    assert np.stack(found.posteriors) == pytest.approx(expected, abs=2e-3)
    assert found.log_evidence == pytest.approx(evidence, abs=2e-3)
    again = log_evidence(likelihoods, times_s, [3.0, diffusion])
    assert again[1] == found.log_evidence
    assert again[0] != again[1]


def test_one_frame_keeps_its_own_posterior() -> None:
    alone = hill(6.0, -4.0)
    weights = np.exp(alone.log_likelihood.astype(np.float64))
    (found,) = smooth([alone], np.zeros(1), 4.0).posteriors
    expected = (1 - OUTLIER_SHARE) * weights / weights.sum() + OUTLIER_SHARE / weights.size
    assert found == pytest.approx(expected, rel=1e-4)


def test_a_frame_that_says_nothing_lies_between_its_neighbours() -> None:
    flat = likelihood(np.zeros((SIZE, SIZE)))
    for silent in (None, flat):
        frames = [hill(-10.0, 6.0), silent, hill(10.0, 18.0)]
        found = answers_m(frames, np.array([0.0, 4.0, 8.0]), 4.0)
        assert found[1] == pytest.approx([0.0, 12.0], abs=0.5)


def test_a_silent_frame_is_less_sure_the_longer_the_gap() -> None:
    spreads = []
    for gap_s in (1.0, 4.0, 16.0):
        times_s = np.array([0.0, gap_s, 2 * gap_s])
        middle = smooth([hill(0.0, 0.0), None, hill(0.0, 0.0)], times_s, 3.0).posteriors[1]
        spreads.append(float(np.sqrt((middle * _squared_m()).sum())))
    assert spreads == sorted(spreads)
    assert spreads[2] > 1.5 * spreads[0]


def _squared_m() -> FloatArray:
    steps = (np.arange(SIZE) - SIZE // 2) * CELL_M
    return np.asarray(steps[None, :] ** 2 + steps[:, None] ** 2)


def test_a_frame_that_errs_is_overruled_by_the_others() -> None:
    """However sure it is: now and then a frame shows something else."""
    frames = [hill(4.0, 2.0) for _ in range(7)]
    frames[3] = hill(-30.0, -24.0, sigma_m=1.0)
    found = answers_m(frames, np.arange(7.0), 2.0)
    assert found == pytest.approx(np.tile([4.0, 2.0], (7, 1)), abs=1.0)


def test_of_two_equal_hills_the_flight_picks_its_own() -> None:
    steps = np.stack([hill(-20.0, 8.0).log_likelihood, hill(16.0, -8.0).log_likelihood])
    either = likelihood(np.logaddexp(*steps.astype(np.float64)))
    found = answers_m([hill(14.0, -8.0), either, hill(18.0, -8.0)], np.arange(3.0), 3.0)
    assert found[1] == pytest.approx([16.0, -8.0], abs=0.5)


def test_an_error_that_wanders_is_followed() -> None:
    truth = np.stack([np.linspace(-24.0, 24.0, 13), 10.0 * np.sin(np.arange(13.0) / 3)], axis=1)
    frames = [hill(east, north, sigma_m=6.0) for east, north in truth]
    found = answers_m(frames, 2.0 * np.arange(13.0), 4.0)
    assert np.abs(found - truth)[1:-1].max() < 2.0  # the ends have neighbours on one side only


def test_averaging_still_frames_beats_each_of_them() -> None:
    noise = np.random.default_rng(2).normal(0.0, 6.0, (30, 2))
    frames = [hill(east, north, sigma_m=6.0) for east, north in noise]
    found = answers_m(frames, np.arange(30.0), 0.5)
    own = np.hypot(*noise.T).mean()
    assert np.hypot(*found.T).mean() < 0.5 * own


def test_forwards_and_backwards_in_time_are_alike() -> None:
    rng = np.random.default_rng(5)
    places = rng.uniform(-16.0, 16.0, (6, 2))
    frames: list[OffsetLikelihood | None] = [hill(east, north, 5.0) for east, north in places]
    frames[2] = None
    times_s = np.array([0.0, 1.0, 2.5, 3.0, 7.0, 8.0])
    there = smooth(frames, times_s, 3.0)
    back = smooth(frames[::-1], times_s[-1] - times_s[::-1], 3.0)
    assert np.stack(back.posteriors[::-1]) == pytest.approx(np.stack(there.posteriors), abs=2e-5)
    assert back.log_evidence == pytest.approx(there.log_evidence, abs=1e-3)


def test_convention_small_grids_that_move_give_what_one_large_grid_gives() -> None:
    truth = [(-12.0, 6.0), (-6.0, 12.0), (2.0, 10.0), (8.0, 2.0), (14.0, -6.0)]
    centres = [(-10.0, 4.0), (-6.0, 10.0), (0.0, 10.0), (7.0, 3.5), (14.0, -4.0)]
    times_s = 3.0 * np.arange(5.0)
    fixed = answers_m([hill(*place, size=61) for place in truth], times_s, 3.0)
    frames = [hill(*at, centre_m=c, size=31) for at, c in zip(truth, centres, strict=True)]
    moving = answers_m(frames, times_s, 3.0, centres)
    assert moving == pytest.approx(fixed, abs=0.2)


def test_a_moving_grid_carries_a_silent_frame_along() -> None:
    centres = [(10.0, -6.0), (10.0, -6.0), (22.0, 2.0)]
    frames = [hill(12.0, -6.0, centre_m=centres[0]), None, hill(20.0, 2.0, centre_m=centres[2])]
    found = answers_m(frames, np.array([0.0, 4.0, 8.0]), 4.0, centres)
    assert found[1] == pytest.approx([16.0, -2.0], abs=0.5)


def test_frames_hours_apart_say_nothing_of_one_another() -> None:
    frames = [hill(20.0, 20.0, sigma_m=2.0), hill(-20.0, -20.0, sigma_m=2.0)]
    found = answers_m(frames, np.array([0.0, 6 * 3600.0]), 4.0)
    assert found == pytest.approx(np.array([[20.0, 20.0], [-20.0, -20.0]]), abs=0.3)


def test_frames_of_one_instant_share_one_error() -> None:
    frames = [hill(2.0, 0.0), hill(6.0, 0.0)]
    found = answers_m(frames, np.zeros(2), 4.0)
    assert found == pytest.approx(np.array([[4.0, 0.0], [4.0, 0.0]]), abs=0.3)


def test_posteriors_are_distributions_whatever_the_frames() -> None:
    frames: list[OffsetLikelihood | None] = [
        hill(38.0, 38.0, sigma_m=0.5, centre_m=(0.0, 0.0)),
        hill(-300.0, 300.0, sigma_m=0.5, centre_m=(-300.0, 300.0)),
        None,
        hill(0.0, 0.0, sigma_m=0.5),
    ]
    found = smooth(frames, np.array([0.0, 0.1, 0.2, 0.3]), 1.0)
    assert np.isfinite(found.log_evidence)
    posteriors = np.stack(found.posteriors)
    assert (posteriors >= 0).all()
    assert posteriors.sum(axis=(1, 2)) == pytest.approx(np.ones(4), abs=1e-4)
