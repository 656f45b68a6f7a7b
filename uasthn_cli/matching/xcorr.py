"""The default estimator: learned cross-correlation over all shifts, brightness beside it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from uasthn_cli.config import DEFAULT_SYMMETRIES
from uasthn_cli.matching.appearance import CHANNELS, appearance_cells, appearance_scores
from uasthn_cli.matching.correlate import cell_mask, correlate, normalise_template
from uasthn_cli.matching.device import choose_device
from uasthn_cli.matching.ncc import luma
from uasthn_cli.matching.networks import HALO_PX, STRIDE_PX, XcorrModel
from uasthn_cli.matching.search import (
    MIN_OVERLAP,
    best_shift,
    posterior_mass,
    view_masks,
    within_reach,
)
from uasthn_cli.matching.similarity import turned_features
from uasthn_cli.matching.symmetries import encode_symmetric
from uasthn_cli.matching.weights import BUNDLED_XCORR, load_xcorr
from uasthn_cli.types import Estimate, FloatArray, MapFeatures, MapWindow, Ortho, Similarity


class XcorrEstimator:
    """Searches map features for thermal features; see :class:`uasthn_cli.types.Estimator`."""

    name = "xcorr"
    stride_px = STRIDE_PX
    halo_px = HALO_PX

    def __init__(
        self, model: XcorrModel, *, device: str = "cpu", symmetries: int = DEFAULT_SYMMETRIES
    ) -> None:
        """Use a trained model on a device, seen under 1 to 8 symmetries."""
        self._device, self._symmetries = torch.device(device), symmetries
        self._model = model.eval().to(self._device)
        self._temperature = float(model.log_temperature.detach().exp())

    @torch.inference_mode()
    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return map features ``(symmetries * C + 2, h / 2, w / 2)``, zero where not valid.

        The last two are brightness and gradient.
        """
        rgb = torch.from_numpy(window.image).permute(2, 0, 1)[None].to(self._device)
        valid = torch.from_numpy(window.valid).float()[None, None].to(self._device)
        mean = torch.tensor([window.statistics.mean], device=self._device)
        deviation = torch.tensor([window.statistics.deviation], device=self._device)

        def encode(image: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            return self._model.encode_satellite(image, mask, mean, deviation)

        features = encode_symmetric(encode, rgb, valid, self._symmetries)
        seen = appearance_cells(luma(window.image), window.valid, STRIDE_PX)
        stacked = np.concatenate([features[0].cpu().numpy(), seen])
        masked: NDArray[np.float32] = stacked * cell_mask(valid, STRIDE_PX)[0].cpu().numpy()
        return masked

    @torch.inference_mode()
    def estimate(
        self, features: MapFeatures, thermal: Ortho, views_px: FloatArray, origin_px: FloatArray
    ) -> Estimate:
        """Return each view at its best shift inside the window; one iteration."""
        encoded, masks = self._encode_views(thermal, views_px)
        scores = self._learned_scores(features, encoded, masks)
        scores = scores + self._appearance_scores(features, thermal, masks)
        overlap = self._overlap(features, masks)
        prior_shift = origin_px / STRIDE_PX
        allowed = (overlap >= MIN_OVERLAP) & within_reach(scores.shape[1:], prior_shift)
        scores = np.where(allowed, scores, -np.inf)
        shifts = np.stack([best_shift(view, otherwise=prior_shift) for view in scores])
        found = views_px + shifts[:, None] * STRIDE_PX
        confidence = posterior_mass(scores[0], shifts[0], STRIDE_PX * thermal.gsd_m)
        return Estimate(found[None], confidence, scores[0])

    @torch.inference_mode()
    def fit_scores(
        self,
        features: MapFeatures,
        thermal: Ortho,
        origin_px: FloatArray,
        hypotheses: Sequence[Similarity],
    ) -> FloatArray:
        """Return the best score of the learned features ``(n,)`` near the prior.

        One orientation is enough here: the place is known.
        """
        channels = self._model.architecture.feature_channels
        image, valid = self._tensors(thermal)
        encoded = self._model.encode_thermal(image, valid)[0]
        window = torch.from_numpy(features.values[:channels]).to(self._device, torch.float32)[None]
        turned, masks = turned_features(encoded, cell_mask(valid, STRIDE_PX)[0], hypotheses)
        templates = normalise_template(turned, masks)
        scores = correlate(window, templates[None], masks[None])[0] * self._temperature
        near = within_reach((scores.shape[-2], scores.shape[-1]), origin_px / STRIDE_PX)
        reachable = scores.double().cpu().numpy()[:, near]
        best: FloatArray = reachable.max(axis=1)
        return best

    def _encode_views(
        self, thermal: Ortho, views_px: FloatArray
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return thermal features ``(1, C, h, w)`` and the views' cell masks ``(N, 1, h, w)``."""
        image, valid = self._tensors(thermal)
        encoded = encode_symmetric(self._model.encode_thermal, image, valid, self._symmetries)
        cells = cell_mask(valid, STRIDE_PX)[0, 0].bool().cpu().numpy()
        masks = torch.from_numpy(view_masks(views_px, cells, STRIDE_PX))[:, None]
        return encoded, masks.to(self._device)

    def _tensors(self, thermal: Ortho) -> tuple[torch.Tensor, torch.Tensor]:
        """Return image and mask ``(1, 1, h, w)``."""
        image = torch.from_numpy(thermal.image)[None, None].to(self._device)
        return image, torch.from_numpy(thermal.valid).float()[None, None].to(self._device)

    def _learned_scores(
        self, features: MapFeatures, encoded: torch.Tensor, masks: torch.Tensor
    ) -> FloatArray:
        """Return log-posterior scores ``(N, rows, columns)`` of every shift."""
        templates = normalise_template(encoded.expand(len(masks), -1, -1, -1), masks)
        learned = features.values[: -len(CHANNELS)]
        window = torch.from_numpy(learned).to(self._device, torch.float32)[None]
        scores = correlate(window, templates[None], masks[None])[0] * self._temperature
        return scores.double().cpu().numpy()

    def _appearance_scores(
        self, features: MapFeatures, thermal: Ortho, masks: torch.Tensor
    ) -> FloatArray:
        """Return what brightness and gradient say of every shift ``(N, rows, columns)``."""
        window = torch.from_numpy(features.values[-len(CHANNELS) :]).to(self._device, torch.float32)
        valid = torch.from_numpy(features.valid).to(self._device, torch.float32)
        cells = appearance_cells(thermal.image, thermal.valid, STRIDE_PX)
        template = torch.from_numpy(cells).to(self._device)
        scores = appearance_scores(window, valid, template, masks[:, 0])
        return scores.double().cpu().numpy()

    def _overlap(self, features: MapFeatures, masks: torch.Tensor) -> FloatArray:
        """Return the share of each view ``(N, rows, columns)`` that falls on valid map."""
        valid = torch.from_numpy(features.valid).to(self._device, torch.float32)
        if bool(valid.all()):
            return np.ones(1)
        counts = torch.nn.functional.conv2d(valid[None, None], masks)[0]
        share = counts / masks.sum(dim=(1, 2, 3)).clamp_min(1.0)[:, None, None]
        return share.double().cpu().numpy()


def open_xcorr(weights_path: Path | None, device: str, symmetries: int) -> XcorrEstimator:
    """Return the estimator with the weights in the box or a user's own, on ``auto|cpu|cuda``.

    Raises:
        WeightsError: the weights cannot be used.
    """
    model = load_xcorr(weights_path or BUNDLED_XCORR).model
    return XcorrEstimator(model, device=choose_device(device), symmetries=symmetries)
