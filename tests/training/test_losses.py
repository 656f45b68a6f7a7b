"""The search's loss: least where the truth is, and errors in pixels."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from uasthn_cli.matching.architecture import STRIDE_PX
from uasthn_cli.training.losses import search_loss, window_statistics

ROWS, COLUMNS, CANVAS_PX = 15, 23, 20


def corners_at(column_cells: float, row_cells: float) -> Tensor:
    """Return corners ``(1, 1, 4, 2)`` of a canvas whose cell (0, 0) lies on a window cell."""
    last = CANVAS_PX - 1.0
    square = torch.tensor([[0.0, 0.0], [last, 0.0], [0.0, last], [last, last]])
    shift = torch.tensor([column_cells, row_cells]) * STRIDE_PX
    return (square + shift)[None, None]


def scores_at(column: int, row: int, peak: float = 20.0) -> Tensor:
    scores = torch.zeros(1, 1, ROWS, COLUMNS)
    scores[0, 0, row, column] = peak
    return scores


@pytest.mark.parametrize(("column", "row"), [(7, 4), (1, 13), (21, 1)])
def test_convention_the_loss_is_least_at_the_true_shift(column: int, row: int) -> None:
    corners = corners_at(column, row)
    losses = {
        (x, y): float(search_loss(scores_at(x, y), corners, CANVAS_PX)[0])
        for x in range(COLUMNS)
        for y in range(ROWS)
    }
    assert min(losses, key=lambda cell: losses[cell]) == (column, row)


@given(
    st.integers(0, COLUMNS - 1),
    st.integers(0, ROWS - 1),
    st.floats(2, COLUMNS - 3),
    st.floats(2, ROWS - 3),
)
def test_errors_are_the_distance_of_the_best_cell_in_pixels(
    column: int, row: int, true_column: float, true_row: float
) -> None:
    corners = corners_at(true_column, true_row)
    _, errors = search_loss(scores_at(column, row), corners, CANVAS_PX)
    expected = STRIDE_PX * np.hypot(column - true_column, row - true_row)
    assert errors.shape == (1, 1)
    assert float(errors) == pytest.approx(expected, abs=1e-4)


def test_gradient_pulls_towards_the_truth() -> None:
    scores = torch.zeros(1, 1, ROWS, COLUMNS, requires_grad=True)
    search_loss(scores, corners_at(7, 4), CANVAS_PX)[0].backward()  # type: ignore[no-untyped-call]
    assert scores.grad is not None
    assert int(scores.grad.flatten().argmin()) == 4 * COLUMNS + 7
    assert float(scores.grad.sum()) == pytest.approx(0, abs=1e-5)


def test_a_truth_between_cells_is_shared_by_them() -> None:
    scores = torch.zeros(1, 1, ROWS, COLUMNS, requires_grad=True)
    search_loss(scores, corners_at(7.5, 4), CANVAS_PX)[0].backward()  # type: ignore[no-untyped-call]
    assert scores.grad is not None
    left, right = scores.grad[0, 0, 4, 7:9]
    assert float(left) == pytest.approx(float(right), rel=1e-4)


def test_tilt_and_turn_do_not_move_the_target() -> None:
    square = corners_at(7, 4)
    centre = square.mean(dim=2, keepdim=True)
    turned = (square - centre) @ torch.tensor([[0.8, 0.6], [-0.6, 0.8]]) + centre
    plain = search_loss(scores_at(7, 4), square, CANVAS_PX)
    for got, expected in zip(search_loss(scores_at(7, 4), turned, CANVAS_PX), plain, strict=True):
        assert torch.allclose(got, expected, atol=1e-4)


def test_statistics_are_of_the_valid_pixels() -> None:
    rng = np.random.default_rng(0)
    rgb = rng.random((2, 3, 8, 10), dtype=np.float32)
    valid = np.zeros((2, 1, 8, 10), np.float32)
    valid[:, :, 2:7, 1:9] = 1
    mean, deviation = window_statistics(torch.from_numpy(rgb), torch.from_numpy(valid))
    seen = rgb[:, :, 2:7, 1:9]
    assert mean.numpy() == pytest.approx(seen.mean(axis=(2, 3)), abs=1e-5)
    spread = np.sqrt(seen.var(axis=(2, 3)).mean(axis=1))
    assert deviation.numpy() == pytest.approx(spread, abs=1e-5)
