"""The map grid and resizing, against what OpenCV and torch do to pixels."""

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.geometry.corners import transform_points
from uasthn_cli.geometry.pixels import (
    box_corner_transform,
    cell_mask,
    grid_to_metres,
    metres_to_grid,
    resize_homography,
)
from uasthn_cli.types import FloatArray, GridBox, MapGrid

coordinates = st.floats(-1e5, 1e5)


@given(st.floats(0.01, 50.0), coordinates, coordinates)
def test_grid_and_metres_are_inverses(gsd_m: float, x: float, y: float) -> None:
    grid = MapGrid(gsd_m)
    point = np.array([[x, y]])
    np.testing.assert_allclose(metres_to_grid(grid, grid_to_metres(grid, point)), point, atol=1e-6)


def test_convention_columns_run_east_and_rows_south() -> None:
    grid = MapGrid(2.5)
    np.testing.assert_allclose(grid_to_metres(grid, np.array([3.0, 4.0])), [7.5, -10.0])


def test_convention_a_box_reaches_half_a_pixel_beyond_its_centres() -> None:
    grid, box = MapGrid(2.5), GridBox(column_px=-3, row_px=7, width_px=5, height_px=4)
    west, north, east, south = box_corner_transform(grid, box)
    first = grid_to_metres(grid, np.array([box.column_px, box.row_px]))
    last = grid_to_metres(
        grid, np.array([box.column_px + box.width_px - 1, box.row_px + box.height_px - 1])
    )
    np.testing.assert_allclose([west, north], first + np.array([-1.25, 1.25]))
    np.testing.assert_allclose([east, south], last + np.array([1.25, -1.25]))


def ramp(width_px: int, height_px: int) -> FloatArray:
    """Return an image whose two channels are the x and y of each pixel's centre."""
    return np.stack(np.meshgrid(np.arange(width_px), np.arange(height_px)), -1).astype(np.float64)


sizes = st.tuples(st.integers(8, 40), st.integers(8, 40))


@given(sizes, sizes)
def test_convention_resize_moves_points_as_opencv_and_torch_move_pixels(
    from_size_px: tuple[int, int], to_size_px: tuple[int, int]
) -> None:
    image = ramp(*from_size_px)
    H_from_to = resize_homography(from_size_px, to_size_px)
    H_to_from = np.asarray(np.linalg.inv(H_from_to), dtype=np.float64)
    expected = transform_points(H_to_from, ramp(*to_size_px).reshape(-1, 2))
    inside = ((expected >= 0) & (expected <= np.array(from_size_px) - 1)).all(axis=1)
    assert inside.any()

    by_opencv = cv2.resize(image, to_size_px, interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(by_opencv.reshape(-1, 2)[inside], expected[inside], atol=1e-2)

    tensor = torch.from_numpy(np.moveaxis(image, -1, 0).copy())[None]
    by_torch = torch.nn.functional.interpolate(
        tensor, size=to_size_px[::-1], mode="bilinear", align_corners=False
    )
    points = np.moveaxis(by_torch[0].numpy(), 0, -1).reshape(-1, 2)
    np.testing.assert_allclose(points[inside], expected[inside], atol=1e-4)


@pytest.mark.parametrize("corner", [(-0.5, -0.5), (19.5, 11.5)])
def test_convention_resize_keeps_the_outer_edges(corner: tuple[float, float]) -> None:
    H = resize_homography((20, 12), (50, 18))
    expected = (-0.5, -0.5) if corner[0] < 0 else (49.5, 17.5)
    np.testing.assert_allclose(transform_points(H, np.array([corner])), [expected])


def test_a_cell_counts_only_if_all_its_pixels_do() -> None:
    valid = np.ones((6, 8), np.bool_)
    valid[3, 5] = False
    expected = np.ones((3, 4), np.bool_)
    expected[1, 2] = False
    np.testing.assert_array_equal(cell_mask(valid, 2), expected)
