"""Displacement models small enough for tests, with random weights."""

from dataclasses import replace
from pathlib import Path

import torch

from uasthn_cli.matching.displacement.checkpoints import serialise_model
from uasthn_cli.matching.displacement.dhn import DhnArchitecture, DirectHomographyNetwork
from uasthn_cli.matching.displacement.ihn import IhnArchitecture, IterativeHomographyNetwork
from uasthn_cli.matching.displacement.model import DisplacementModel, ModelSettings

FIRST = IhnArchitecture(block_widths=(8, 8), feature_channels=8, update_channels=8)
SECOND = IhnArchitecture(levels=2, block_widths=(8, 8), feature_channels=8, update_channels=8)
SETTINGS = ModelSettings(width_ratio=3.0, iterations=2, second_iterations=1)


def small_model(name: str, seed: int = 1) -> DisplacementModel:
    """Return a ``dhn``, ``ihn`` or ``sthn``, or ``dhn+dm``, which models its own deviations."""
    torch.manual_seed(seed)
    if name in ("dhn", "dhn+dm"):
        size = DhnArchitecture((8, 8, 8, 8, 8), 16, has_uncertainty_head=name == "dhn+dm")
        network = DirectHomographyNetwork(size).eval()
        return DisplacementModel(network, None, SETTINGS)
    first = IterativeHomographyNetwork(FIRST).eval()
    second = IterativeHomographyNetwork(SECOND).eval() if name == "sthn" else None
    return DisplacementModel(first, second, SETTINGS)


def small_weights(folder: Path, name: str, seed: int = 1) -> Path:
    """Write a small model's weights in our own layout and return their path."""
    path = folder / (f"{name}.safetensors" if seed == 1 else f"{name}-{seed}.safetensors")
    path.write_bytes(serialise_model(small_model(name, seed)))
    return path


def fixed_weights(
    path: Path, shift_px: tuple[float, float] = (0.0, 0.0), log_variance: float | None = None
) -> Path:
    """Write an ``ihn`` that always answers the prior moved by ``shift_px`` at W_R; return its path.

    With ``log_variance`` it has a second head that always states this one.
    """
    architecture = replace(FIRST, has_uncertainty_head=log_variance is not None)
    settings = ModelSettings(width_ratio=1.0, iterations=2)
    torch.manual_seed(1)
    network = IterativeHomographyNetwork(architecture).eval()
    weights = network.state_dict()
    answer = "update_block_4.cnn.layer10.3"
    weights[f"{answer}.weight"].zero_()
    weights[f"{answer}.bias"].copy_(torch.tensor(shift_px) / settings.iterations)
    if log_variance is not None:
        weights[f"ue_{answer}.weight"].zero_()
        weights[f"ue_{answer}.bias"].fill_(log_variance)
    path.write_bytes(serialise_model(DisplacementModel(network, None, settings)))
    return path
