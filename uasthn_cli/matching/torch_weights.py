"""Weights of the learned cross-correlation to and from torch's modules."""

import json
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors.torch import save

from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.weights import (
    XCORR_FORMAT,
    canonical_safetensors,
    read_xcorr,
    weights_misfit,
)


@dataclass(frozen=True, slots=True)
class LoadedXcorr:
    """A model ready for inference and the notes that its training left in the file."""

    model: XcorrModel
    notes: dict[str, str]


def serialise_xcorr(model: XcorrModel, notes: dict[str, str]) -> bytes:
    """Return a weights file's content; floats are stored in half precision to keep it small.

    Equal weights and notes give equal bytes.
    """
    tensors = {
        name: (value.half() if value.is_floating_point() and value.ndim > 1 else value)
        .detach()
        .cpu()
        .contiguous()
        for name, value in model.state_dict().items()
    }
    metadata = {
        "format": XCORR_FORMAT,
        "architecture": json.dumps(model.architecture.as_metadata(), sort_keys=True),
        **notes,
    }
    return canonical_safetensors(bytes(save(tensors, metadata)))


def load_xcorr(path: Path) -> LoadedXcorr:
    """Read a weights file written by ``uasthn train`` into a model.

    Raises:
        WeightsError: missing, not safetensors, or of another kind of network.
    """
    weights = read_xcorr(path)
    try:
        model = XcorrModel(weights.architecture)
        model.load_state_dict({k: torch.from_numpy(v) for k, v in weights.tensors.items()})
    except (TypeError, ValueError, RuntimeError) as error:
        raise weights_misfit(path) from error
    return LoadedXcorr(model.eval(), dict(weights.notes))
