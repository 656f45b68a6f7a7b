"""The encoders by torch: on a GPU, and for networks that are no files."""

import hashlib

import torch

from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.types import BoolArray, ImageArray, MapStatistics


class TorchEncoders:
    """Encoders on a device; see :class:`uasthn_cli.matching.encoders.Encoders`."""

    def __init__(self, model: XcorrModel, device: str = "cpu") -> None:
        """Use a trained model."""
        self._device = torch.device(device)
        self._model = model.eval().to(self._device)
        self.channels = model.architecture.feature_channels
        self.temperature = float(model.log_temperature.detach().exp())
        digest = hashlib.sha256(f"torch {torch.__version__} {device}".encode())
        for name, value in sorted(model.state_dict().items()):
            digest.update(name.encode() + value.detach().cpu().numpy().tobytes())
        self.identity = digest.hexdigest()

    @torch.inference_mode()
    def satellite(self, rgb: ImageArray, valid: BoolArray, statistics: MapStatistics) -> ImageArray:
        """Return features ``(C, h / 2, w / 2)`` of colours ``(3, h, w)`` in 0..1."""
        mean = torch.tensor([statistics.mean], device=self._device)
        deviation = torch.tensor([statistics.deviation], device=self._device)
        features = self._model.encode_satellite(
            self._tensor(rgb)[None], self._mask(valid), mean, deviation
        )
        return _array(features[0])

    @torch.inference_mode()
    def thermal(self, image: ImageArray, valid: BoolArray) -> ImageArray:
        """Return features ``(C, h / 2, w / 2)`` of a frame ``(h, w)``."""
        features = self._model.encode_thermal(self._tensor(image)[None, None], self._mask(valid))
        return _array(features[0])

    def _tensor(self, image: ImageArray) -> torch.Tensor:
        return torch.from_numpy(image).to(self._device)

    def _mask(self, valid: BoolArray) -> torch.Tensor:
        return torch.from_numpy(valid).to(self._device, torch.float32)[None, None]


def _array(features: torch.Tensor) -> ImageArray:
    array: ImageArray = features.float().cpu().numpy()
    return array
