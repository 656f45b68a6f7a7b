"""What a file of weights holds: of any of the package's networks."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.displacement.checkpoints import (
    FORMATS,
    load_displacement,
    read_safetensors,
)
from uasthn_cli.matching.hub import PICKLED_FILE, SAFETENSORS_FILE, sha256_of
from uasthn_cli.matching.registry import XCORR
from uasthn_cli.matching.torch_weights import load_xcorr

AUTHORS_LAYOUT = "authors' checkpoint"

_XCORR = "uasthn-xcorr-"


@dataclass(frozen=True, slots=True)
class WeightsInfo:
    """A weights file: which estimator it is for, its layout, size, hash and what it says itself."""

    estimator: str
    layout: str
    file: Path
    size_bytes: int
    sha256: str
    parameters: int
    architecture: Mapping[str, Any]
    notes: Mapping[str, str]


def bundled() -> tuple[Path, ...]:
    """Return the weights in the box."""
    return XCORR.bundled_weights


def describe(path: Path) -> WeightsInfo:
    """Read weights and say what they are; ``path`` is a file or a Hugging Face folder.

    Raises:
        WeightsError: they cannot be read, or are for no network here.
    """
    file = _weights_file(path)
    layout = AUTHORS_LAYOUT
    if file.suffix == ".safetensors" and file.is_file():
        layout = read_safetensors(file)[1].get("format", AUTHORS_LAYOUT)
    if layout.startswith(_XCORR):
        loaded = load_xcorr(file)
        notes = {k: v for k, v in loaded.notes.items() if k not in ("format", "architecture")}
        tensors = loaded.model.state_dict()
        name, architecture = "xcorr", loaded.model.architecture.as_metadata()
    else:
        model = load_displacement(file)
        name, architecture = model.name, model.architecture()
        tensors, notes = model.tensors(), dict(model.notes)
        layout = layout if layout in FORMATS else AUTHORS_LAYOUT
    return WeightsInfo(
        estimator=name,
        layout=layout,
        file=file,
        size_bytes=file.stat().st_size,
        sha256=sha256_of(file),
        parameters=sum(value.numel() for value in tensors.values()),
        architecture=architecture,
        notes=notes,
    )


def _weights_file(path: Path) -> Path:
    """Return the file that holds the weights of a folder, or the file itself."""
    if not path.is_dir():
        return path
    for name in (SAFETENSORS_FILE, PICKLED_FILE):
        if (path / name).is_file():
            return path / name
    raise WeightsError(f"{path}: holds neither {SAFETENSORS_FILE} nor {PICKLED_FILE}")
