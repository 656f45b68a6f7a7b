"""Four corners ⇄ homography.

Corners are ordered top-left, top-right, bottom-left, bottom-right; arrays ``(..., 4, 2)`` hold
``(x, y)`` with pixel centres on whole numbers. ``H_a_b`` maps points of ``a`` to points of ``b``.
"""

import numpy as np

from uasthn_cli.types import FloatArray

_MIN_DETERMINANT = 1e-9
_MIN_TRIANGLE = 1e-6
"""Of corners at unit mean distance from their centre: twice the smallest triangle's area."""


class DegenerateHomographyError(ValueError):
    """Four points do not define a homography (three lie on a line, or a value is not finite)."""


def image_corners_px(width_px: int, height_px: int) -> FloatArray:
    """Return the centres of an image's corner pixels ``(4, 2)``."""
    right, bottom = width_px - 1.0, height_px - 1.0
    return np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])


def homography_from_corners(corners_a: FloatArray, corners_b: FloatArray) -> FloatArray:
    """Return ``H_a_b`` ``(..., 3, 3)`` from corners ``(..., 4, 2)`` by the DLT (paper, eq. 1).

    Raises:
        DegenerateHomographyError: the corners do not define a homography.
    """
    a, b = np.broadcast_arrays(
        np.asarray(corners_a, dtype=np.float64), np.asarray(corners_b, dtype=np.float64)
    )
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise DegenerateHomographyError("corners are not finite")
    T_a, T_b = _normaliser(a), _normaliser(b)
    a_n, b_n = transform_points(T_a, a), transform_points(T_b, b)
    if min(_smallest_triangle(a_n), _smallest_triangle(b_n)) < _MIN_TRIANGLE:
        raise DegenerateHomographyError("three corners lie on one line")
    H_n = _solve_unit_dlt(a_n, b_n)
    H: FloatArray = np.linalg.inv(T_b) @ H_n @ T_a
    if not (np.abs(H[..., 2, 2]) > _MIN_DETERMINANT * np.abs(H[..., 2, :]).max(axis=-1)).all():
        raise DegenerateHomographyError("the origin of the first image is mapped to infinity")
    return H / H[..., 2:, 2:]


def transform_points(H_a_b: FloatArray, points_a: FloatArray) -> FloatArray:
    """Map points ``(..., n, 2)`` of ``a`` by ``H_a_b`` ``(..., 3, 3)`` to points of ``b``."""
    points = np.asarray(points_a, dtype=np.float64)
    ones = np.ones((*points.shape[:-1], 1))
    mapped = np.concatenate([points, ones], axis=-1) @ np.swapaxes(H_a_b, -1, -2)
    result: FloatArray = mapped[..., :2] / mapped[..., 2:]
    return result


def is_convex(corners: FloatArray) -> bool:
    """Tell whether corners ``(4, 2)`` form a convex quadrilateral of the image's own handedness."""
    ring = corners[[0, 1, 3, 2]]
    edges = np.roll(ring, -1, axis=0) - ring
    following = np.roll(edges, -1, axis=0)
    cross = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    return bool((cross > 0).all())


def area_px(corners: FloatArray) -> float:
    """Return the signed area of corners ``(4, 2)``, positive for the image's own handedness."""
    x, y = corners[[0, 1, 3, 2]].T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _normaliser(points: FloatArray) -> FloatArray:
    """Return the similarity ``(..., 3, 3)`` that centres points and scales them to unit spread."""
    mean = points.mean(axis=-2)
    spread = np.linalg.norm(points - mean[..., None, :], axis=-1).mean(axis=-1)
    if not (spread > 0).all():
        raise DegenerateHomographyError("corners coincide")
    T = np.zeros((*points.shape[:-2], 3, 3))
    T[..., 0, 0] = T[..., 1, 1] = 1.0 / spread
    T[..., :2, 2] = -mean / spread[..., None]
    T[..., 2, 2] = 1.0
    return T


def _smallest_triangle(points: FloatArray) -> float:
    """Return twice the area of the smallest triangle among four points ``(..., 4, 2)``.

    A corner on the line through two others makes the homography singular even where the DLT
    equations still have a solution (it sends the fourth corner to 0/0).
    """
    triangles = points[..., [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]], :]
    u, v = np.moveaxis(triangles[..., 1:, :] - triangles[..., :1, :], -2, 0)
    return float(np.abs(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]).min())


def _solve_unit_dlt(a: FloatArray, b: FloatArray) -> FloatArray:
    """Solve the eight DLT equations with ``H[2, 2] = 1`` for normalised corners."""
    A = np.zeros((*a.shape[:-2], 8, 8))
    for k in range(4):
        x, y = a[..., k, 0], a[..., k, 1]
        for axis in (0, 1):
            row, target = 2 * k + axis, b[..., k, axis]
            A[..., row, 3 * axis] = x
            A[..., row, 3 * axis + 1] = y
            A[..., row, 3 * axis + 2] = 1.0
            A[..., row, 6] = -x * target
            A[..., row, 7] = -y * target
    if not (np.abs(np.linalg.det(A)) > _MIN_DETERMINANT).all():
        raise DegenerateHomographyError("the middle of the corners is mapped to infinity")
    h = np.linalg.solve(A, b.reshape(*b.shape[:-2], 8, 1))[..., 0]
    ones = np.ones((*h.shape[:-1], 1))
    return np.concatenate([h, ones], axis=-1).reshape(*h.shape[:-1], 3, 3)
