"""Losses of the search: where the posterior over shifts should have its mass."""

import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor

from uasthn_cli.matching.architecture import STRIDE_PX
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.training.correlate import cell_mask, correlate, normalise_template

TARGET_SIGMA_CELLS = 0.8


def encode_batch(
    model: XcorrModel, satellite: Tensor, satellite_valid: Tensor, thermal: Tensor, valid: Tensor
) -> tuple[Tensor, Tensor]:
    """Return map features ``(B, C, …)``, 0 where not valid, and templates ``(B · K, C, …)``.

    Templates have zero mean and unit norm under their masks. Inputs as in
    :class:`uasthn_cli.training.samples.Batch`.
    """
    mean, deviation = window_statistics(satellite, satellite_valid)
    features = model.encode_satellite(satellite, satellite_valid, mean, deviation).float()
    flat, flat_valid = thermal.flatten(0, 1), valid.flatten(0, 1)
    templates = model.encode_thermal(flat, flat_valid).float()
    return (
        features * cell_mask(satellite_valid, STRIDE_PX),
        normalise_template(templates, cell_mask(flat_valid, STRIDE_PX)),
    )


def scores_of(model: XcorrModel, encoded: tuple[Tensor, Tensor], valid: Tensor) -> Tensor:
    """Return log-posterior scores ``(B, K, shifts_y, shifts_x)`` of every canvas.

    ``encoded`` by :func:`encode_batch`, ``valid`` ``(B, K, 1, h, w)`` the canvases' masks.
    """
    features, templates = encoded
    mask = cell_mask(valid.flatten(0, 1), STRIDE_PX)
    templates, mask = (t.view(*valid.shape[:2], *t.shape[1:]) for t in (templates, mask))
    scores = correlate(features, templates, mask)
    return scores * model.log_temperature.exp()


def search_scores(
    model: XcorrModel, satellite: Tensor, satellite_valid: Tensor, thermal: Tensor, valid: Tensor
) -> Tensor:
    """Return :func:`scores_of` what a batch is encoded to; inputs as in :func:`encode_batch`."""
    encoded = encode_batch(model, satellite, satellite_valid, thermal, valid)
    return scores_of(model, encoded, valid)


def search_loss(scores: Tensor, corners_px: Tensor, canvas_px: int) -> tuple[Tensor, Tensor]:
    """Return the cross-entropy against a narrow Gaussian at the true shift, and errors in pixels.

    ``corners_px`` ``(B, K, 4, 2)`` of the canvas in the window; errors ``(B, K)`` of the best cell.
    """
    shift = (corners_px.mean(dim=2) - (canvas_px - 1) / 2) / STRIDE_PX
    rows, columns = scores.shape[-2:]
    target = (
        _gaussian(shift[..., 1], rows)[..., :, None]
        * _gaussian(shift[..., 0], columns)[..., None, :]
    )
    target = target / target.sum(dim=(-2, -1), keepdim=True)
    log_posterior = F.log_softmax(scores.flatten(2), dim=2).view_as(scores)
    loss = -(target * log_posterior).sum(dim=(-2, -1)).mean()
    best = scores.detach().flatten(2).argmax(dim=2)
    found = torch.stack([best % columns, best // columns], dim=-1).float()
    return loss, (found - shift).norm(dim=-1) * STRIDE_PX


def _gaussian(centre: Tensor, length: int) -> Tensor:
    cells = torch.arange(length, device=centre.device, dtype=centre.dtype)
    return torch.exp(-((cells - centre[..., None]) ** 2) / (2 * TARGET_SIGMA_CELLS**2))


def window_statistics(satellite: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean ``(B, 3)`` and deviation ``(B,)`` of the valid pixels."""
    count = valid.sum(dim=(2, 3)).clamp_min(1.0)
    mean = (satellite * valid).sum(dim=(2, 3)) / count
    centred = (satellite - mean[:, :, None, None]) * valid
    variance = (centred**2).sum(dim=(2, 3)) / count
    return mean, variance.mean(dim=1).sqrt()
