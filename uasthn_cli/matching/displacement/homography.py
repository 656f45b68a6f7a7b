"""Corner displacements, homographies and crops of batches, in torch.

Corners and displacements are ``(..., 4, 2)`` in the package's order (``CONVENTIONS.md``), in pixels
of an image of width W_R unless a width is given.
"""

import torch
from torch import Tensor
from torch.nn import functional

from uasthn_cli.config import RESIZED_WIDTH_PX


def square_corners(width_px: float, like: Tensor) -> Tensor:
    """Return the corner pixels' centres ``(4, 2)`` of a square image, type and device of another.

    ``width_px`` may be a fraction: widths of boxes are.
    """
    last = width_px - 1.0
    return like.new_tensor([[0.0, 0.0], [last, 0.0], [0.0, last], [last, last]])


def corners_at_width(displacement: Tensor, width_px: float) -> Tensor:
    """Return corners ``(..., 4, 2)`` in pixels of a square image that was resized to W_R.

    A displacement grows as the widths do while corners lie at the centres of corner pixels: the
    authors' convention, and so that of their weights.
    """
    return square_corners(width_px, displacement) + displacement * (width_px / RESIZED_WIDTH_PX)


def displacement_at_resized(corners_px: Tensor, width_px: float) -> Tensor:
    """Return displacements at W_R: the inverse of :func:`corners_at_width`."""
    return (corners_px - square_corners(width_px, corners_px)) * (RESIZED_WIDTH_PX / width_px)


def solve_homography(corners_a: Tensor, corners_b: Tensor) -> Tensor:
    """Return ``H_a_b`` ``(B, 3, 3)`` float64 from corners ``(B, 4, 2)`` by the DLT (paper, eq. 1).

    Corners that define none give NaN: one bad sample must not end a batch.
    """
    x, y = corners_a.double().unbind(-1)
    u, v = corners_b.double().unbind(-1)
    zero, one = torch.zeros_like(x), torch.ones_like(x)
    rows = [
        torch.stack([x, y, one, zero, zero, zero, -x * u, -y * u], dim=-1),
        torch.stack([zero, zero, zero, x, y, one, -x * v, -y * v], dim=-1),
    ]
    solution, failed = torch.linalg.solve_ex(torch.cat(rows, dim=1), torch.cat([u, v], dim=1))
    solution = torch.where((failed != 0)[:, None], torch.nan, solution)
    return torch.cat([solution, one[:, :1]], dim=1).reshape(-1, 3, 3)


def map_points(H_a_b: Tensor, points_a: Tensor) -> Tensor:
    """Map points ``(B, n, 2)`` of ``a`` by ``H_a_b`` ``(B, 3, 3)`` to points of ``b``."""
    mapped = functional.pad(points_a.to(H_a_b.dtype), (0, 1), value=1.0) @ H_a_b.mT
    return mapped[..., :2] / mapped[..., 2:]


def recover_displacement(crop_corners: Tensor, displacement: Tensor) -> Tensor:
    """Return displacements ``(B, 4, 2)`` of whole images from those of their crops (eqs. 1-5).

    ``crop_corners`` ``(B, 4, 2)`` are the crops' corners in the whole thermal image.
    """
    whole = square_corners(RESIZED_WIDTH_PX, displacement).expand_as(displacement)
    H_thermal_satellite = solve_homography(crop_corners, whole + displacement)
    return map_points(H_thermal_satellite, whole).to(displacement.dtype) - whole


def sample_boxes(images: Tensor, boxes_px: Tensor) -> Tensor:
    """Cut upright boxes out of images ``(B, C, h, w)`` and bring them to W_R by W_R pixels.

    ``boxes_px`` ``(B, 4, 2)`` are the places of the result's corner pixels; beyond the image all is
    0. Plain bilinear sampling, also where that skips pixels: as published.
    """
    height_px, width_px = images.shape[-2:]
    steps = torch.linspace(0.0, 1.0, RESIZED_WIDTH_PX, device=images.device, dtype=images.dtype)
    first, last = boxes_px[:, 0, :, None], boxes_px[:, 3, :, None]
    x, y = (first + steps * (last - first)).unbind(1)
    x, y = x * (2.0 / (width_px - 1)) - 1.0, y * (2.0 / (height_px - 1)) - 1.0
    count = RESIZED_WIDTH_PX
    grid = torch.stack(
        [x[:, None, :].expand(-1, count, -1), y[:, :, None].expand(-1, -1, count)], dim=-1
    )
    return functional.grid_sample(images, grid.to(images.dtype), align_corners=True)


def resize_to_network(images: Tensor) -> Tensor:
    """Resize square images ``(B, C, w, w)`` to W_R as the published weights saw them."""
    return functional.interpolate(
        images,
        size=(RESIZED_WIDTH_PX, RESIZED_WIDTH_PX),
        mode="bilinear",
        align_corners=True,
        antialias=True,
    )
