"""The default estimator: learned cross-correlation over all shifts, brightness beside it."""

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from uasthn_cli.config import DEFAULT_SYMMETRIES
from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.appearance import CHANNELS, appearance_cells, appearance_scores
from uasthn_cli.matching.correlate import cell_mask
from uasthn_cli.matching.device import choose_device
from uasthn_cli.matching.identity import arithmetic, code_sha256, weights_sha256
from uasthn_cli.matching.member import Member
from uasthn_cli.matching.ncc import luma
from uasthn_cli.matching.networks import HALO_PX, STRIDE_PX, XcorrModel
from uasthn_cli.matching.search import (
    MIN_OVERLAP,
    best_shift,
    posterior_mass,
    view_masks,
    within_reach,
)
from uasthn_cli.matching.weights import BUNDLED_ENSEMBLE, BUNDLED_XCORR, load_xcorr
from uasthn_cli.seam import Estimate, Similarity
from uasthn_cli.types import FloatArray, MapFeatures, MapWindow, Ortho


class XcorrEstimator:
    """Searches map features for thermal features; see :class:`uasthn_cli.seam.Estimator`."""

    name = "xcorr"
    stride_px = STRIDE_PX
    halo_px = HALO_PX

    def __init__(
        self,
        models: XcorrModel | Sequence[XcorrModel],
        *,
        device: str = "cpu",
        symmetries: int = DEFAULT_SYMMETRIES,
        appearance: bool = True,
    ) -> None:
        """Use one trained model, or several whose scores are averaged, on a device.

        ``symmetries`` (1 to 8) are shared out among the members, at least one to each. Without
        ``appearance`` brightness and gradient have no say.
        """
        self._appearance = appearance
        self._device = torch.device(device)
        chosen = [models] if isinstance(models, XcorrModel) else list(models)
        share = max(1, symmetries // len(chosen))
        self._models, self._symmetries = chosen, share
        self._members = [Member(model, self._device, share) for model in chosen]

    @property
    def encoding_id(self) -> str:
        """What shapes features beside the window; see :class:`uasthn_cli.seam.CacheableEncoder`."""
        return f"{self._settings_id} {arithmetic(self._device)}"

    @cached_property
    def _settings_id(self) -> str:
        settings = (self.name, self._symmetries, self._appearance)
        return f"{settings} {weights_sha256(self._models)} {code_sha256()}"

    @torch.inference_mode()
    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return map features ``(C + 2, h / 2, w / 2)`` of all members, zero where not valid.

        The last two are brightness and gradient, if these have a say.
        """
        rgb = torch.from_numpy(window.image).permute(2, 0, 1)[None].to(self._device)
        valid = torch.from_numpy(window.valid).float()[None, None].to(self._device)
        learned = [m.encode_map(rgb, valid, window.statistics)[0] for m in self._members]
        layers = [features.cpu().numpy() for features in learned]
        if self._appearance:
            whole = cell_mask(valid, STRIDE_PX)[0].cpu().numpy()
            layers.append(appearance_cells(luma(window.image), window.valid, STRIDE_PX) * whole)
        stacked: NDArray[np.float32] = np.concatenate(layers)
        return stacked

    @torch.inference_mode()
    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return each view at its best shift inside the window."""
        image, valid = self._tensors(thermal)
        cells = cell_mask(valid, STRIDE_PX)[0, 0].bool().cpu().numpy()
        masks = torch.from_numpy(view_masks(views_px, cells, STRIDE_PX))[:, None].to(self._device)
        scores = self._average(
            member.scores(window, image, valid, masks) for member, window in self._windows(features)
        )
        if self._appearance:
            scores = scores + self._appearance_scores(features, thermal, masks)
        if evidence is not None:
            scores = scores + evidence
        overlap = self._overlap(features, masks)
        prior_shift = origin_px / STRIDE_PX
        allowed = (overlap >= MIN_OVERLAP) & within_reach(scores.shape[1:], prior_shift)
        scores = np.where(allowed, scores, -np.inf)
        shifts = np.stack([best_shift(view, otherwise=prior_shift) for view in scores])
        found = views_px + shifts[:, None] * STRIDE_PX
        confidence = posterior_mass(scores[0], shifts[0], STRIDE_PX * thermal.gsd_m)
        return Estimate(found, confidence, scores[0])

    @torch.inference_mode()
    def fit_scores(
        self,
        features: MapFeatures,
        thermal: Ortho,
        origin_px: FloatArray,
        hypotheses: Sequence[Similarity],
    ) -> FloatArray:
        """Return the best score of the learned features ``(n,)`` near the prior."""
        image, valid = self._tensors(thermal)
        scores = self._average(
            member.turned_scores(window, image, valid, hypotheses)
            for member, window in self._windows(features)
        )
        near = within_reach((scores.shape[-2], scores.shape[-1]), origin_px / STRIDE_PX)
        best: FloatArray = scores[:, near].max(axis=1)
        return best

    def _windows(self, features: MapFeatures) -> Iterator[tuple[Member, torch.Tensor]]:
        """Yield each member with its map features ``(1, channels, h, w)``."""
        first = 0
        for member in self._members:
            own = features.values[first : first + member.channels]
            yield member, torch.from_numpy(own).to(self._device, torch.float32)[None]
            first += member.channels

    def _average(self, scores: Iterable[torch.Tensor]) -> FloatArray:
        """Return the members' mean scores."""
        return torch.stack(list(scores)).double().mean(dim=0).cpu().numpy()

    def _tensors(self, thermal: Ortho) -> tuple[torch.Tensor, torch.Tensor]:
        """Return image and mask ``(1, 1, h, w)``."""
        image = torch.from_numpy(thermal.image)[None, None].to(self._device)
        return image, torch.from_numpy(thermal.valid).float()[None, None].to(self._device)

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


def open_xcorr(
    weights: Sequence[Path],
    device: str,
    symmetries: int,
    *,
    ensemble: bool = False,
    appearance: bool = True,
) -> XcorrEstimator:
    """Return the estimator with a user's own weights, or those in the box, on ``auto|cpu|cuda``.

    The scores of several are averaged; ``ensemble`` averages all members in the box; ``appearance``
    as in :class:`XcorrEstimator`.

    Raises:
        WeightsError: the weights cannot be used, or an ensemble of a user's own was asked for.
    """
    if ensemble and weights:
        raise WeightsError("--ensemble is of the weights in the box; leave out --weights")
    paths = BUNDLED_ENSEMBLE if ensemble else (weights or (BUNDLED_XCORR,))
    models = [load_xcorr(path).model for path in paths]
    return XcorrEstimator(
        models, device=choose_device(device), symmetries=symmetries, appearance=appearance
    )
