"""Weights as safetensors: the architecture travels in the file's metadata, no code ever does."""

import json
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.networks import XcorrArchitecture, XcorrModel
from uasthn_cli.matching.registry import XCORR

BUNDLED_ENSEMBLE = XCORR.bundled_weights
BUNDLED_XCORR = BUNDLED_ENSEMBLE[0]
_FORMAT = "uasthn-xcorr-2"


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
        "format": _FORMAT,
        "architecture": json.dumps(model.architecture.as_metadata(), sort_keys=True),
        **notes,
    }
    return canonical_safetensors(bytes(save(tensors, metadata)))


def load_xcorr(path: Path) -> LoadedXcorr:
    """Read a weights file written by ``uasthn train``.

    Raises:
        WeightsError: missing, not safetensors, or of another kind of network.
    """
    if not path.is_file():
        raise WeightsError(f"{path}: no such weights file; give --weights a .safetensors file")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path}: not a readable safetensors file ({error})") from error
    if metadata.get("format") != _FORMAT:
        raise WeightsError(
            f"{path}: these weights are not for the xcorr estimator of this version ({_FORMAT})"
        )
    try:
        stored = json.loads(metadata["architecture"])
        w1, w2, w3, w4 = stored["widths"]
        architecture = XcorrArchitecture(
            int(stored["feature_channels"]), (int(w1), int(w2), int(w3), int(w4))
        )
        model = XcorrModel(architecture)
        model.load_state_dict({name: _as_float(value) for name, value in tensors.items()})
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise WeightsError(f"{path}: weights do not fit their stated architecture") from error
    return LoadedXcorr(model.eval(), metadata)


def canonical_safetensors(content: bytes) -> bytes:
    """Return the same safetensors file with its header in order, so equal weights are equal bytes.

    The format is eight bytes of header length (little-endian), the header as JSON padded with
    spaces to a multiple of eight, then the tensors; the library writes metadata in random order.
    """
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    text = json.dumps(header, sort_keys=True, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + content[8 + length :]


def _as_float(value: torch.Tensor) -> torch.Tensor:
    return value.float() if value.is_floating_point() else value
