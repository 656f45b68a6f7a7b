"""Generators as safetensors: architecture and scale travel in the file's metadata."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import nn

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.weights import canonical_safetensors
from uasthn_cli.training.tgm.generators import (
    GeneratorArchitecture,
    GeneratorKind,
    build_generator,
)

FORMAT: Final = "uasthn-tgm-1"


@dataclass(frozen=True, slots=True)
class TrainedGenerator:
    """A generator, what it is built like, and the images it knows.

    ``size_px`` is the side of the images it was trained on, ``gsd_m`` their metres per pixel.
    """

    network: nn.Module
    architecture: GeneratorArchitecture
    size_px: int
    gsd_m: float


def serialise_generator(generator: TrainedGenerator, notes: dict[str, str]) -> bytes:
    """Return a weights file's content; floats are stored in half precision to keep it small.

    Equal weights and notes give equal bytes.
    """
    tensors = {
        name: (value.half() if value.ndim > 1 else value).detach().cpu().contiguous()
        for name, value in generator.network.state_dict().items()
    }
    metadata = {
        "format": FORMAT,
        "architecture": json.dumps(generator.architecture.as_metadata(), sort_keys=True),
        "size_px": str(generator.size_px),
        "gsd_m": f"{generator.gsd_m:.9g}",
        **notes,
    }
    return canonical_safetensors(bytes(save(tensors, metadata)))


def load_generator(path: Path) -> TrainedGenerator:
    """Read a generator written by ``uasthn tgm train``, ready to draw.

    Raises:
        WeightsError: missing, not safetensors, or of another kind of network.
    """
    if not path.is_file():
        raise WeightsError(f"{path}: no such weights file; give one that uasthn tgm train wrote")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path}: not a readable safetensors file ({error})") from error
    if metadata.get("format") != FORMAT:
        raise WeightsError(
            f"{path}: these are not weights of a thermal generator ({FORMAT}); give a file that"
            " uasthn tgm train wrote"
        )
    try:
        stored = json.loads(metadata["architecture"])
        architecture = GeneratorArchitecture(
            GeneratorKind(stored["kind"]),
            *(int(stored[name]) for name in ("width", "levels", "blocks")),
        )
        network = build_generator(architecture)
        network.load_state_dict(tensors)
        size_px, gsd_m = int(metadata["size_px"]), float(metadata["gsd_m"])
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise WeightsError(f"{path}: weights do not fit their stated architecture") from error
    if size_px < 1 or not (math.isfinite(gsd_m) and gsd_m > 0):
        raise WeightsError(f"{path}: states no sensible size ({size_px} px of {gsd_m:g} m)")
    return TrainedGenerator(network.eval(), architecture, size_px, gsd_m)
