"""Losses of displacements: over steps, over crops (paper, eq. 9), and with their own deviations.

All are in pixels of W_R and the mean over a batch's corners and coordinates, so the paper's sums
over eight coordinates divided by eight.
"""

from typing import Final

import torch
from torch import Tensor

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.matching.displacement.homography import (
    map_points,
    recover_displacement,
    solve_homography,
    square_corners,
)
from uasthn_cli.matching.displacement.network import Refinement

_FARTHEST_PX: Final = 4.0 * RESIZED_WIDTH_PX
"""A crop whose homography throws the whole image's corners farther says nothing of them."""


def sequence_loss(displacements: Tensor, truth: Tensor, decay: float) -> Tensor:
    """Return the L1 distance of displacements ``(K, B, 4, 2)`` from the truth ``(B, 4, 2)``.

    Step k of K counts ``decay ** (K - k - 1)``: the last one fully (paper, eq. 9).
    """
    return _over_steps((displacements - truth).abs(), decay)


def direct_modeling_loss(refinement: Refinement, truth: Tensor, decay: float) -> Tensor:
    """Return the negative log-likelihood of the truth, without its constant, over the steps.

    Each coordinate is a Gaussian whose log-variance the second head gives (Kendall & Gal 2017,
    eq. 8).

    Raises:
        ValueError: the network has no such head.
    """
    if refinement.log_variances is None:
        raise ValueError("Direct Modeling needs a network with an uncertainty head")
    squared = (refinement.displacements - truth).square()
    scaled = 0.5 * (-refinement.log_variances).exp() * squared
    return _over_steps(scaled + 0.5 * refinement.log_variances, decay)


def croptta_loss(
    displacements: Tensor, truth: Tensor, crop_corners: Tensor, decay: float
) -> Tensor:
    """Return the loss of whole images plus that of each crop's view of them (paper, eq. 9).

    ``displacements`` ``(K, N_C * B, 4, 2)``, the B whole images first, then view by view;
    ``crop_corners`` ``(N_C - 1, B, 4, 2)`` in the resized thermal image. A crop's displacement
    becomes the whole image's by its homography (eqs. 1-5); where it defines no usable one, as early
    in training, its own corners are compared with where they should be.
    """
    steps = len(displacements)
    views = displacements.reshape(steps, -1, *truth.shape)
    loss = sequence_loss(views[:, 0], truth, decay)
    for view, corners in enumerate(crop_corners, start=1):
        found = views[:, view]
        flat, repeated = found.flatten(0, 1), corners.repeat(steps, 1, 1)
        own = crop_displacement(corners, truth).repeat(steps, 1, 1)
        usable = _is_usable(repeated, flat)
        # what is not usable must not enter the solver at all: its gradient would be NaN
        recovered = recover_displacement(repeated, torch.where(usable, flat, own))
        errors = torch.where(usable, recovered - truth.repeat(steps, 1, 1), flat - own).abs()
        loss = loss + _over_steps(errors.reshape(found.shape), decay)
    return loss


def crop_displacement(crop_corners: Tensor, displacement: Tensor) -> Tensor:
    """Return the displacements ``(B, 4, 2)`` of crops, as images of their own, from the whole's.

    The inverse of :func:`uasthn_cli.matching.displacement.homography.recover_displacement`.
    """
    whole = square_corners(RESIZED_WIDTH_PX, displacement).expand_as(displacement)
    H_thermal_satellite = solve_homography(whole, whole + displacement)
    return map_points(H_thermal_satellite, crop_corners).to(displacement.dtype) - whole


@torch.no_grad()
def _is_usable(crop_corners: Tensor, displacement: Tensor) -> Tensor:
    """Tell ``(B, 1, 1)`` which crops' displacements give the whole image's in a sane place."""
    recovered = recover_displacement(crop_corners, displacement)
    reach_px = recovered.abs().amax(dim=(1, 2), keepdim=True)
    return reach_px < _FARTHEST_PX  # false for NaN too


def _over_steps(errors: Tensor, decay: float) -> Tensor:
    """Return the decayed sum over steps of errors ``(K, B, 4, 2)``, each step's mean taken."""
    means = errors.float().mean(dim=(1, 2, 3))
    powers = torch.arange(len(means) - 1, -1, -1, device=means.device)
    return (decay**powers * means).sum()
