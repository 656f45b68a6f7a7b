"""A model for the learned estimator whose encoders are simple known functions."""

import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor, nn

from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_encoders import TorchEncoders


class LargeScaleBrightness(nn.Module):
    """Features of one channel: brightness against the whole map or frame, at half resolution."""

    def __init__(self, channel: int) -> None:
        super().__init__()
        self.channel = channel

    def forward(self, x: Tensor) -> Tensor:
        return F.avg_pool2d(x[:, self.channel : self.channel + 1], 2)


def known_model() -> XcorrModel:
    """Return a model whose encoders see the same in a grey map and in a thermal cut of it."""
    model = XcorrModel(XcorrArchitecture(feature_channels=1, widths=(4, 4, 4, 4)))
    model.satellite_encoder = LargeScaleBrightness(3)  # type: ignore[assignment]
    model.thermal_encoder = LargeScaleBrightness(1)  # type: ignore[assignment]
    return model


def known_encoders() -> TorchEncoders:
    """Return :func:`known_model` as encoders."""
    return TorchEncoders(known_model())
