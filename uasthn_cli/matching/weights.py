"""Weights as safetensors: the architecture travels in the file's metadata, no code ever does."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.types import ImageArray

XCORR_FORMAT = "uasthn-xcorr-2"


@dataclass(frozen=True, slots=True)
class XcorrWeights:
    """A weights file: both encoders' tensors (float32) by name, and the notes of its training."""

    architecture: XcorrArchitecture
    tensors: Mapping[str, ImageArray]
    notes: Mapping[str, str]


def read_xcorr(path: Path) -> XcorrWeights:
    """Read a weights file written by ``uasthn train``.

    Raises:
        WeightsError: missing, not safetensors, or of another kind of network.
    """
    if not path.is_file():
        raise WeightsError(f"{path}: no such weights file; give --weights a .safetensors file")
    try:
        with safe_open(path, framework="np") as file:
            metadata = dict(file.metadata() or {})
            tensors = {name: _as_float(file.get_tensor(name)) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, TypeError) as error:
        raise WeightsError(f"{path}: not a readable safetensors file ({error})") from error
    if metadata.get("format") != XCORR_FORMAT:
        raise WeightsError(
            f"{path}: these weights are not for the xcorr estimator of this version"
            f" ({XCORR_FORMAT})"
        )
    try:
        stored = json.loads(metadata["architecture"])
        w1, w2, w3, w4 = (int(width) for width in stored["widths"])
        architecture = XcorrArchitecture(int(stored["feature_channels"]), (w1, w2, w3, w4))
    except (KeyError, TypeError, ValueError) as error:
        raise weights_misfit(path) from error
    return XcorrWeights(architecture, tensors, metadata)


def weights_misfit(path: Path) -> WeightsError:
    """Return the error of a file whose tensors are not those of the network it names."""
    return WeightsError(f"{path}: weights do not fit their stated architecture")


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


def _as_float(value: NDArray[Any]) -> ImageArray:
    return value.astype(np.float32)
