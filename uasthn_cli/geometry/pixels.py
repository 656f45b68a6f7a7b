"""Pixel centres, the map grid and raster transforms.

The centre of the top-left pixel is (0, 0). A raster's affine transform speaks of pixel *corners*,
so the map coordinates of pixel ``(x, y)`` are ``transform * (x + 0.5, y + 0.5)``.
"""

import numpy as np

from uasthn_cli.types import BoolArray, FloatArray, GridBox, MapGrid


def grid_to_metres(grid: MapGrid, points_px: FloatArray) -> FloatArray:
    """Map grid pixels ``(..., 2)`` to metres ``(east, north)`` in the flight's local CRS."""
    return np.asarray(points_px, dtype=np.float64) * (grid.gsd_m, -grid.gsd_m)


def metres_to_grid(grid: MapGrid, points_m: FloatArray) -> FloatArray:
    """Map metres ``(east, north)`` ``(..., 2)`` in the flight's local CRS to grid pixels."""
    return np.asarray(points_m, dtype=np.float64) / (grid.gsd_m, -grid.gsd_m)


def box_corner_transform(grid: MapGrid, box: GridBox) -> tuple[float, float, float, float]:
    """Return ``(west_m, north_m, east_m, south_m)``: the outer edges of a box of grid pixels."""
    west, north = (box.column_px - 0.5) * grid.gsd_m, -(box.row_px - 0.5) * grid.gsd_m
    return (
        west,
        north,
        west + box.width_px * grid.gsd_m,
        north - box.height_px * grid.gsd_m,
    )


def resize_homography(from_size_px: tuple[int, int], to_size_px: tuple[int, int]) -> FloatArray:
    """Return the homography of a resize between ``(width, height)`` sizes, pixel areas kept.

    Edges coincide (corner of the first pixel on corner of the first pixel), as in
    ``cv2.resize`` and ``interpolate(align_corners=False)``.
    """
    sx, sy = to_size_px[0] / from_size_px[0], to_size_px[1] / from_size_px[1]
    return np.array([[sx, 0.0, 0.5 * sx - 0.5], [0.0, sy, 0.5 * sy - 0.5], [0.0, 0.0, 1.0]])


def cell_mask(valid: BoolArray, stride_px: int) -> BoolArray:
    """Return ``(h / stride, w / stride)``: true where every pixel of a cell is valid."""
    rows, columns = valid.shape[0] // stride_px, valid.shape[1] // stride_px
    blocks = valid[: rows * stride_px, : columns * stride_px]
    lines = np.logical_and.reduce(blocks.reshape(rows, stride_px, -1), axis=1)
    cells = lines.reshape(rows, columns, stride_px)
    return np.asarray(np.logical_and.reduce(cells, axis=2), np.bool_)
