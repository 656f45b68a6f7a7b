"""One trained network of the learned cross-correlation, alone or as a member of an ensemble."""

from collections.abc import Sequence

import torch
from torch import Tensor

from uasthn_cli.matching.correlate import cell_mask, correlate, normalise_template
from uasthn_cli.matching.networks import STRIDE_PX, XcorrModel
from uasthn_cli.matching.similarity import turned_features
from uasthn_cli.matching.symmetries import encode_symmetric
from uasthn_cli.seam import Similarity
from uasthn_cli.types import MapStatistics


class Member:
    """Encodes maps and frames under some symmetries, and scores shifts."""

    def __init__(self, model: XcorrModel, device: torch.device, symmetries: int) -> None:
        """Use a trained model on a device, seen under 1 to 8 symmetries."""
        self._model, self._symmetries = model.eval().to(device), symmetries
        self._temperature = float(model.log_temperature.detach().exp())

    @property
    def channels(self) -> int:
        """Feature channels, those of all symmetries together."""
        return self._symmetries * self._model.architecture.feature_channels

    def encode_map(self, rgb: Tensor, valid: Tensor, statistics: MapStatistics) -> Tensor:
        """``(1, 3, H, W)``, ``(1, 1, H, W)`` to ``(1, channels, H / 2, W / 2)``; 0 if not valid."""
        mean = torch.tensor([statistics.mean], device=rgb.device)
        deviation = torch.tensor([statistics.deviation], device=rgb.device)

        def encode(image: Tensor, mask: Tensor) -> Tensor:
            return self._model.encode_satellite(image, mask, mean, deviation)

        features = encode_symmetric(encode, rgb, valid, self._symmetries)
        return features * cell_mask(valid, STRIDE_PX)

    def scores(self, window: Tensor, image: Tensor, valid: Tensor, masks: Tensor) -> Tensor:
        """Return log-likelihoods ``(N, rows, columns)`` of every shift of N views.

        ``window`` ``(1, channels, H, W)`` map features, ``image``, ``valid`` ``(1, 1, h, w)`` the
        frame, ``masks`` ``(N, 1, h / 2, w / 2)`` its views.
        """
        encoded = encode_symmetric(self._model.encode_thermal, image, valid, self._symmetries)
        templates = normalise_template(encoded.expand(len(masks), -1, -1, -1), masks)
        return correlate(window, templates[None], masks[None])[0] * self._temperature

    def turned_scores(
        self, window: Tensor, image: Tensor, valid: Tensor, hypotheses: Sequence[Similarity]
    ) -> Tensor:
        """Return the same ``(n, rows, columns)`` of the frame turned and scaled in n ways.

        One symmetry is enough here: the place is known.
        """
        first = window[:, : self._model.architecture.feature_channels]
        encoded = self._model.encode_thermal(image, valid)[0]
        turned, masks = turned_features(encoded, cell_mask(valid, STRIDE_PX)[0], hypotheses)
        templates = normalise_template(turned, masks)
        return correlate(first, templates[None], masks[None])[0] * self._temperature
