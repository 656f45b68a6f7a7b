"""Scores become likelihoods over the log's error, and likelihoods a few numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.fusion.offsets import (
    OffsetGrid,
    Placement2d,
    best_offset_m,
    ce90_of,
    cell_offsets_m,
    grid_of_radius,
    offset_likelihood,
    posterior_of,
    scores_elsewhere,
    summarise_posterior,
)
from uasthn_cli.types import FloatArray, OffsetLikelihood

ROWS, COLUMNS = 70, 110
AT_PRIOR = np.zeros(2)


def peak_at(column: float, row: float, sharpness: float = 0.05) -> FloatArray:
    """Return scores ``(70, 110)`` with one peak."""
    rows, columns = np.mgrid[:ROWS, :COLUMNS].astype(float)
    scores: FloatArray = -sharpness * ((columns - column) ** 2 + (rows - row) ** 2)
    return scores


def placed(pitch_m: float, prior: tuple[float, float]) -> Placement2d:
    """Return a placement by the entry ``(column, row)`` at which the prior is right."""
    return Placement2d(pitch_m, np.array(prior) * pitch_m)


def rounding(log_likelihood: float) -> float:
    """Return by how much a log-likelihood may be rounded."""
    return 0.031 * math.sqrt(-log_likelihood) + 0.001


def found_m(likelihood: OffsetLikelihood) -> FloatArray:
    """Return the best offset ``(east, north)``."""
    posterior = posterior_of(likelihood)
    return best_offset_m(posterior, likelihood.cell_m, likelihood.centre_m)


def gaussian(
    grid: OffsetGrid, mean_m: tuple[float, float], covariance_m2: FloatArray
) -> FloatArray:
    """Return a normal posterior on a grid around the prior."""
    east, north = cell_offsets_m(grid.size, grid.cell_m, AT_PRIOR)
    away = np.stack(np.broadcast_arrays(east - mean_m[0], north - mean_m[1]), axis=-1)
    weights = np.exp(-0.5 * np.einsum("...i,ij,...j", away, np.linalg.inv(covariance_m2), away))
    return np.asarray(weights / weights.sum())


@given(
    east=st.integers(-20, 20),
    north=st.integers(-20, 20),
    pitch_m=st.floats(0.5, 4.0),
    prior=st.tuples(st.floats(40.0, 60.0), st.floats(30.0, 40.0)),
)
def test_convention_a_peak_comes_back_east_and_north_of_the_prior(
    east: int, north: int, pitch_m: float, prior: tuple[float, float]
) -> None:
    """Columns go east, rows go south; the scores are wider than high."""
    scores = peak_at(prior[0] + east, prior[1] - north, sharpness=0.5)
    grid = OffsetGrid(25, pitch_m)
    likelihood = offset_likelihood(scores, placed(pitch_m, prior), grid, AT_PRIOR)
    assert likelihood.log_likelihood.shape == (51, 51)
    row, column = np.unravel_index(int(likelihood.log_likelihood.argmax()), (51, 51))
    assert (int(column) - 25, 25 - int(row)) == (east, north)
    assert found_m(likelihood) == pytest.approx([east * pitch_m, north * pitch_m], abs=pitch_m / 20)


def test_convention_offsets_count_from_the_logs_position_not_from_the_moved_prior() -> None:
    likelihood = offset_likelihood(
        peak_at(53.0, 30.0), placed(2.0, (50.0, 35.0)), OffsetGrid(20, 2.0), np.array([100.0, 40.0])
    )
    assert found_m(likelihood) == pytest.approx([106.0, 50.0], abs=0.05)
    east, north = cell_offsets_m(41, 2.0, likelihood.centre_m)
    assert (east.shape, north.shape) == ((1, 41), (41, 1))
    assert (east[0, 0], east[0, -1]) == (60.0, 140.0)
    assert (north[0, 0], north[-1, 0]) == (80.0, 0.0)


@given(column=st.integers(30, 80), row=st.integers(20, 50), cell_m=st.sampled_from([2.0, 3.7, 9.0]))
def test_a_coarser_grid_keeps_a_peak_of_one_score(column: int, row: int, cell_m: float) -> None:
    scores = np.full((ROWS, COLUMNS), -40.0)
    scores[row, column] = 0.0
    prior = (55.0, 35.0)
    grid = OffsetGrid(math.ceil(40 / cell_m), cell_m)
    likelihood = offset_likelihood(scores, placed(1.0, prior), grid, AT_PRIOR)
    values = likelihood.log_likelihood
    assert values.max() == 0.0
    expected = [column - prior[0], prior[1] - row]
    assert found_m(likelihood) == pytest.approx(expected, abs=cell_m)
    east, north = cell_offsets_m(grid.size, cell_m, AT_PRIOR)
    far = np.hypot(east - expected[0], north - expected[1])
    unseen = math.log(1.0 / scores.size)  # beyond the scores: the mean of what was seen
    assert values[far > 3 * cell_m].max() <= unseen + rounding(unseen)
    assert (values < -30.0).any()


@given(column=st.floats(45.0, 65.0), row=st.floats(28.0, 42.0))
def test_a_finer_grid_finds_a_peak_between_scores(column: float, row: float) -> None:
    scores = peak_at(column, row, sharpness=0.5)
    grid = OffsetGrid(60, 0.5)
    likelihood = offset_likelihood(scores, placed(2.0, (55.0, 35.0)), grid, AT_PRIOR)
    expected = [2.0 * (column - 55.0), 2.0 * (35.0 - row)]
    assert found_m(likelihood) == pytest.approx(expected, abs=0.2)


def test_scores_that_say_nothing_or_are_excluded_give_a_flat_likelihood() -> None:
    grid, placement = OffsetGrid(4, 2.0), placed(2.0, (50.0, 35.0))
    for scores in (np.full((ROWS, COLUMNS), -np.inf), np.zeros((ROWS, COLUMNS))):
        flat = offset_likelihood(scores, placement, grid, np.array([3.0, 1.0]))
        assert not flat.log_likelihood.any()
        assert flat.levels.dtype == np.uint8
        assert flat.centre_m.tolist() == [3.0, 1.0]


def test_where_nothing_was_seen_a_frame_says_nothing() -> None:
    scores = peak_at(50.0, 35.0, sharpness=0.5)
    scores[:, :40] = -np.inf
    likelihood = offset_likelihood(scores, placed(2.0, (50.0, 35.0)), OffsetGrid(60, 2.0), AT_PRIOR)
    values = likelihood.log_likelihood.astype(np.float64)
    seen = np.exp(scores[np.isfinite(scores)] - scores.max())
    level = math.log(seen.mean())
    assert values[60, 60] == 0.0
    tolerance = rounding(level)
    assert values[60, 60 - 12] == pytest.approx(level, abs=tolerance)  # excluded
    assert values[60 + 37 :] == pytest.approx(level, abs=tolerance)  # below the last row of scores
    assert values[60, 60 + 8] < level  # seen, and not there


def test_half_a_view_is_at_most_half_sure() -> None:
    scores = peak_at(70.0, 35.0, sharpness=2.0)
    scores[:, : COLUMNS // 2] = -np.inf
    grid = OffsetGrid(30, 2.0)
    middle = ((COLUMNS - 1) / 2, (ROWS - 1) / 2)
    posterior = posterior_of(offset_likelihood(scores, placed(2.0, middle), grid, AT_PRIOR))
    answer_m = best_offset_m(posterior, grid.cell_m, AT_PRIOR)
    summary = summarise_posterior(posterior, grid.cell_m, AT_PRIOR, answer_m)
    assert 0.3 < summary.confidence < 0.6


def test_beyond_the_search_radius_nothing_can_lie() -> None:
    grid = grid_of_radius(40.0, 2.0)
    likelihood = offset_likelihood(
        np.zeros((ROWS, COLUMNS)), placed(2.0, (55.0, 35.0)), grid, AT_PRIOR
    )
    east, north = cell_offsets_m(grid.size, grid.cell_m, AT_PRIOR)
    beyond = np.hypot(east, north) > 40.0
    assert (likelihood.log_likelihood[beyond] == -60.0).all()
    assert (likelihood.log_likelihood[~beyond] == 0.0).all()


@given(level=st.floats(-1e4, 1e4), spread=st.floats(0.0, 1e4))
def test_likelihoods_are_finite_and_up_to_0(level: float, spread: float) -> None:
    noise = np.random.default_rng(0).normal(level, spread, (30, 40))
    likelihood = offset_likelihood(noise, placed(1.0, (20.0, 15.0)), OffsetGrid(9, 1.3), AT_PRIOR)
    values = likelihood.log_likelihood
    assert np.isfinite(values).all()
    assert values.max() == 0.0
    assert posterior_of(likelihood).sum() == pytest.approx(1.0)


@given(radius_m=st.floats(10.0, 2000.0), pitch_m=st.floats(0.2, 10.0))
def test_a_grid_holds_the_radius_is_no_finer_than_scores_and_of_bounded_size(
    radius_m: float, pitch_m: float
) -> None:
    grid = grid_of_radius(radius_m, pitch_m)
    assert grid.half * grid.cell_m >= radius_m * (1 - 1e-12)
    assert grid.cell_m >= pitch_m
    assert grid.size <= 2 * 101 + 1
    assert grid_of_radius(100.0, 2.0) == OffsetGrid(50, 2.0, 100.0)


@given(
    mean_m=st.tuples(st.floats(-20, 20), st.floats(-20, 20)),
    sigmas_m=st.tuples(st.floats(2.0, 5.0), st.floats(2.0, 5.0)),
    correlation=st.floats(-0.8, 0.8),
)
def test_the_summary_of_a_normal_posterior_is_its_own(
    mean_m: tuple[float, float], sigmas_m: tuple[float, float], correlation: float
) -> None:
    cross = correlation * sigmas_m[0] * sigmas_m[1]
    covariance_m2 = np.array([[sigmas_m[0] ** 2, cross], [cross, sigmas_m[1] ** 2]])
    grid = OffsetGrid(60, 1.0)
    posterior = gaussian(grid, mean_m, covariance_m2)
    answer_m = best_offset_m(posterior, grid.cell_m, AT_PRIOR)
    assert answer_m == pytest.approx(mean_m, abs=0.1)
    summary = summarise_posterior(posterior, grid.cell_m, AT_PRIOR, answer_m)
    assert summary.confidence == pytest.approx(1.0, abs=1e-3)
    # a cell is a square: its own variance is part of what is not known
    expected = covariance_m2 + np.eye(2) / 12
    assert summary.covariance_m2 == pytest.approx(expected, abs=0.02 * np.trace(covariance_m2))
    assert summary.sigma_m == pytest.approx(math.sqrt(np.trace(covariance_m2) / 2), rel=0.01)
    entropy = 0.5 * math.log((2 * math.pi * math.e) ** 2 * np.linalg.det(covariance_m2))
    assert summary.entropy_nats == pytest.approx(entropy, abs=0.02)  # cells of 1 m²


def test_convention_the_covariance_is_east_by_north() -> None:
    covariance_m2 = np.array([[25.0, 6.0], [6.0, 4.0]])
    grid = OffsetGrid(60, 1.0)
    posterior = gaussian(grid, (3.0, -2.0), covariance_m2)
    found = summarise_posterior(posterior, 1.0, AT_PRIOR, np.array([3.0, -2.0])).covariance_m2
    assert found == pytest.approx(covariance_m2 + np.eye(2) / 12, abs=0.05)


def test_a_second_hill_lowers_confidence_and_leaves_the_covariance() -> None:
    grid = OffsetGrid(60, 2.0)
    narrow = np.eye(2) * 9.0
    one = gaussian(grid, (-40.0, 0.0), narrow)
    two = 0.6 * one + 0.4 * gaussian(grid, (60.0, 10.0), narrow)
    answer_m = best_offset_m(two, 2.0, AT_PRIOR)
    assert answer_m == pytest.approx([-40.0, 0.0], abs=0.01)
    alone, shared = (summarise_posterior(p, 2.0, AT_PRIOR, answer_m) for p in (one, two))
    assert (alone.confidence, shared.confidence) == pytest.approx((1.0, 0.6), abs=1e-3)
    assert shared.covariance_m2 == pytest.approx(alone.covariance_m2, abs=1e-6)
    assert shared.sigma_m > 10 * alone.sigma_m


def test_a_posterior_of_one_cell_is_no_surer_than_the_cell() -> None:
    posterior = np.zeros((11, 11))
    posterior[2, 8] = 1.0
    answer_m = best_offset_m(posterior, 3.0, AT_PRIOR)
    assert answer_m == pytest.approx([9.0, 9.0])
    summary = summarise_posterior(posterior, 3.0, AT_PRIOR, answer_m)
    assert summary.covariance_m2 == pytest.approx(np.eye(2) * 9 / 12)
    assert (summary.entropy_nats, summary.sigma_m) == (0.0, 0.0)


def test_ce90_holds_nine_tenths_of_normal_errors() -> None:
    rng = np.random.default_rng(1)
    for covariance_m2 in (np.eye(2) * 7.0, np.array([[9.0, 2.0], [2.0, 6.0]])):
        errors_m = np.hypot(*rng.multivariate_normal(np.zeros(2), covariance_m2, 100_000).T)
        share = float((errors_m <= ce90_of(covariance_m2)).mean())
        assert share == pytest.approx(0.9, abs=0.01)
    assert ce90_of(np.eye(2)) == pytest.approx(2.1460, abs=1e-4)


@given(
    place_m=st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0)),
    pitch_m=st.floats(0.8, 2.0),
    onto_m=st.floats(1.0, 3.0),
)
def test_convention_scores_keep_their_ground_on_another_lattice(
    place_m: tuple[float, float], pitch_m: float, onto_m: float
) -> None:
    placement, onto = placed(pitch_m, (50.0, 33.0)), placed(onto_m, (31.5, 27.25))
    column, row = (placement.prior_m + place_m) / pitch_m
    scores = peak_at(float(column), float(row), sharpness=0.05 * pitch_m**2)
    elsewhere = scores_elsewhere(scores, placement, onto, (50, 70))
    assert elsewhere.shape == (50, 70)
    at_row, at_column = np.unravel_index(int(elsewhere.argmax()), elsewhere.shape)
    found_m = np.array([at_column, at_row]) * onto_m - onto.prior_m
    assert found_m == pytest.approx(np.array(place_m), abs=onto_m / 2 + pitch_m)


def test_where_nothing_was_seen_scores_elsewhere_are_neutral() -> None:
    scores = peak_at(50.0, 33.0)
    scores[:, :20] = -np.inf
    lattice = placed(1.0, (50.0, 33.0))
    elsewhere = scores_elsewhere(scores, lattice, lattice, scores.shape)
    seen = np.isfinite(scores)
    assert np.isfinite(elsewhere).all()
    assert elsewhere[~seen] == pytest.approx(np.log(np.exp(scores[seen]).mean()), abs=1e-3)
    nothing = scores_elsewhere(np.full((4, 5), -np.inf), lattice, lattice, (3, 7))
    assert not nothing.any()
    assert nothing.shape == (3, 7)


@given(
    seed=st.integers(0, 99),
    answer_m=st.tuples(st.floats(-90.0, 90.0), st.floats(-90.0, 90.0)),
    cell_m=st.sampled_from([1.0, 4.0, 12.0]),
)
def test_a_summary_is_the_sum_over_all_cells(
    seed: int, answer_m: tuple[float, float], cell_m: float
) -> None:
    """An answer may lie beside the grid."""
    posterior = np.random.default_rng(seed).random((15, 15)) ** 9
    posterior /= posterior.sum()
    centre_m = np.array([7.0, -3.0])
    found = summarise_posterior(posterior, cell_m, centre_m, np.array(answer_m))
    east, north = cell_offsets_m(15, cell_m, centre_m)
    east, north = east - answer_m[0], north - answer_m[1]
    squared = east**2 + north**2
    near = posterior * (squared <= max(TOLERANCE_M, 3 * cell_m) ** 2)
    weights = near / max(near.sum(), 1e-12)
    across = (weights * east * north).sum()
    square = [[(weights * east**2).sum(), across], [across, (weights * north**2).sum()]]
    assert found.confidence == pytest.approx(min(1.0, near.sum()))
    assert found.sigma_m == pytest.approx(math.sqrt((posterior * squared).sum() / 2))
    assert found.entropy_nats == pytest.approx(-(posterior * np.log(posterior)).sum())
    assert found.covariance_m2 == pytest.approx(np.array(square) + np.eye(2) * cell_m**2 / 12)
