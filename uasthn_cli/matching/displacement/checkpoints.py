"""Weights of displacement networks, in three layouts; none is ever unpickled.

- ours: safetensors with format and architecture in its metadata (``uasthn-ihn-1``, ...);
- the authors' checkpoint ``.pth``: a dictionary with ``netG``, for two stages also ``netG_fine``;
- the authors' Hugging Face folder: ``config.json`` with ``model.safetensors`` or
  ``pytorch_model.bin``.
"""

import json
import pickle
import re
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.errors import WeightsError
from uasthn_cli.matching.displacement.correlation import CHANNELS_PER_LEVEL
from uasthn_cli.matching.displacement.ihn import IhnArchitecture
from uasthn_cli.matching.displacement.model import (
    FIRST_STAGE,
    NAMES,
    SECOND_STAGE,
    DisplacementModel,
    ModelSettings,
    authors_config,
    model_of,
)
from uasthn_cli.matching.hub import CONFIG_FILE, PICKLED_FILE, SAFETENSORS_FILE
from uasthn_cli.matching.weights import canonical_safetensors

FORMATS = {f"uasthn-{name}-1": name for name in NAMES}
"""Ids of our own layout, and the estimator each is for."""

_THERMAL_WIDTH_PX = 512
"""W_T of the paper, which the authors' configuration does not mention."""

_STAGE = re.compile(r"(?:(?:model|module)\.)*(netG_fine|netG)\.(?:module\.)*(.+)")
_HEAD = "ue_update_block_4."


def load_displacement(path: Path) -> DisplacementModel:
    """Read weights in any of the three layouts; ``path`` is a file, or a folder of the third.

    Raises:
        WeightsError: missing, unreadable, of another kind of network, or not plain tensors.
    """
    if path.is_dir():
        return _load_folder(path)
    if not path.is_file():
        raise WeightsError(f"{path}: no such weights file or folder")
    if path.suffix != ".safetensors":
        return _from_names(path, dict(_flat(_unpickled_tensors(path))), _config_beside(path))
    tensors, metadata = read_safetensors(path)
    if metadata.get("format") in FORMATS:
        return _from_metadata(path, tensors, metadata)
    return _from_names(path, tensors, _config_beside(path))


def read_safetensors(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Return tensors and metadata of a safetensors file.

    Raises:
        WeightsError: it is none.
    """
    try:
        with safe_open(path, framework="pt") as file:
            names = list(file.keys())
            return {name: file.get_tensor(name) for name in names}, dict(file.metadata() or {})
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path}: not a readable safetensors file ({error})") from error


def serialise_model(model: DisplacementModel) -> bytes:
    """Return our own layout's content, in float32; equal weights and notes give equal bytes."""
    metadata = {
        **model.notes,
        "format": f"uasthn-{model.name}-1",
        "architecture": json.dumps(model.architecture(), sort_keys=True),
    }
    return canonical_safetensors(bytes(save(model.tensors(), metadata)))


def serialise_checkpoint(model: DisplacementModel) -> bytes:
    """Return the content of the authors' ``.pth`` layout.

    Raises:
        WeightsError: their layout has no such network.
    """
    _refuse_dhn(model)
    stages: dict[str, dict[str, Tensor]] = {}
    for name, value in model.tensors().items():
        stage, _, rest = name.partition(".")
        stages.setdefault(stage, {})[rest] = value
    buffer = BytesIO()
    torch.save(stages, buffer)
    return buffer.getvalue()


def serialise_folder(model: DisplacementModel) -> dict[str, bytes]:
    """Return the files of the authors' Hugging Face layout by name.

    Raises:
        WeightsError: their layout has no such network.
    """
    _refuse_dhn(model)
    config = json.dumps(authors_config(model), indent=2, sort_keys=True) + "\n"
    return {
        SAFETENSORS_FILE: canonical_safetensors(bytes(save(model.tensors(), {"format": "pt"}))),
        CONFIG_FILE: config.encode(),
    }


def _refuse_dhn(model: DisplacementModel) -> None:
    if model.name == "dhn":
        raise WeightsError("the authors' layouts have no dhn: convert it to a .safetensors file")


def _load_folder(folder: Path) -> DisplacementModel:
    """Read the Hugging Face layout, safetensors before anything pickled."""
    for name in (SAFETENSORS_FILE, PICKLED_FILE):
        if (folder / name).is_file():
            return load_displacement(folder / name)
    raise WeightsError(f"{folder}: holds neither {SAFETENSORS_FILE} nor {PICKLED_FILE}")


def _unpickled_tensors(path: Path) -> Any:
    """Return a checkpoint's content, refusing all that is not tensors and plain containers."""
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise WeightsError(
            f"{path}: holds more than plain tensors, or is no checkpoint; it is not loaded, since"
            " unpickling could run code: ask for a .safetensors file"
        ) from error
    except (RuntimeError, OSError, EOFError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise WeightsError(f"{path}: not a readable checkpoint ({reason})") from error


def _flat(content: Any, prefix: str = "") -> Iterator[tuple[str, Tensor]]:
    """Yield all tensors of nested dictionaries with dotted names."""
    if isinstance(content, Tensor):
        yield prefix.removesuffix("."), content
    elif isinstance(content, Mapping):
        for name, value in content.items():
            yield from _flat(value, f"{prefix}{name}.")


def _config_beside(path: Path) -> Mapping[str, Any]:
    """Return what a ``config.json`` beside Hugging Face weights says; nothing for other files."""
    config_path = path.with_name(CONFIG_FILE)
    if path.name not in (SAFETENSORS_FILE, PICKLED_FILE) or not config_path.is_file():
        return {}
    try:
        config = json.loads(config_path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise WeightsError(f"{config_path}: not readable JSON ({error})") from error
    if not isinstance(config, dict):
        raise WeightsError(f"{config_path}: not a JSON object")
    return config


def _from_metadata(
    path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, str]
) -> DisplacementModel:
    """Return a model of our own layout."""
    notes = {key: value for key, value in metadata.items() if key not in ("format", "architecture")}
    try:
        architecture = json.loads(metadata["architecture"])
        model = model_of(FORMATS[metadata["format"]], architecture, notes)
    except (KeyError, TypeError, ValueError) as error:
        raise WeightsError(f"{path}: does not state its architecture") from error
    return _filled(path, model, _stages(tensors))


def _from_names(
    path: Path, tensors: Mapping[str, Tensor], config: Mapping[str, Any]
) -> DisplacementModel:
    """Return a model of the authors', whose size is in the tensors' shapes."""
    stages = _stages(tensors)
    if FIRST_STAGE not in stages:
        raise WeightsError(
            f"{path}: holds no displacement network (no tensor named {FIRST_STAGE}... or fnet1...)"
        )
    try:
        architecture = {name: _ihn_architecture(stage) for name, stage in stages.items()}
        settings = _settings(config)
    except (KeyError, IndexError, TypeError, ValueError, ZeroDivisionError) as error:
        raise WeightsError(f"{path}: not an IHN or STHN that is known here ({error})") from error
    name = "sthn" if SECOND_STAGE in stages else "ihn"
    described = {key: value.as_metadata() for key, value in architecture.items()}
    model = model_of(name, {**described, "settings": settings.as_metadata()}, {})
    return _filled(path, model, stages)


def _stages(tensors: Mapping[str, Tensor]) -> dict[str, dict[str, Tensor]]:
    """Return each stage's tensors without prefixes; a lone stage may have none."""
    stages: dict[str, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        named = _STAGE.fullmatch(name)
        if named is not None:
            stages.setdefault(named[1], {})[named[2]] = value
    if stages:
        return stages
    lone = {name.removeprefix("module."): value for name, value in tensors.items()}
    return {FIRST_STAGE: lone} if "fnet1.conv1.weight" in lone else {}


def _ihn_architecture(stage: Mapping[str, Tensor]) -> IhnArchitecture:
    """Return the size of a stage from its tensors' shapes."""
    channels, inputs = stage["update_block_4.cnn.layer1.0.weight"].shape[:2]
    levels, left_over = divmod(inputs - 2, CHANNELS_PER_LEVEL)
    if left_over or levels < 1:
        raise ValueError(f"{inputs} input channels are no whole number of correlation levels")
    widths = (len(stage["fnet1.conv1.weight"]), len(stage["fnet1.layer3.0.conv1.weight"]))
    return IhnArchitecture(
        levels=levels,
        has_uncertainty_head=any(name.startswith(_HEAD) for name in stage),
        block_widths=widths,
        feature_channels=len(stage["fnet1.conv2.weight"]),
        update_channels=channels,
    )


def _settings(config: Mapping[str, Any]) -> ModelSettings:
    """Return how the authors' configuration wants its model used."""
    width_px = float(config.get("database_size", ModelSettings().width_ratio * _THERMAL_WIDTH_PX))
    if config.get("resize_width", RESIZED_WIDTH_PX) != RESIZED_WIDTH_PX:
        raise ValueError(f"images of {config['resize_width']} pixels; only 256 are known here")
    defaults = ModelSettings()
    padding_px = float(config.get("fine_padding", defaults.box_padding * width_px))
    return ModelSettings(
        width_ratio=width_px / _THERMAL_WIDTH_PX,
        iterations=int(config.get("iters_lev0", defaults.iterations)),
        second_iterations=int(config.get("iters_lev1", defaults.second_iterations)),
        box_padding=padding_px / width_px,
    )


def _filled(
    path: Path, model: DisplacementModel, stages: Mapping[str, Mapping[str, Tensor]]
) -> DisplacementModel:
    """Put stored weights, as float32, into a model."""
    networks = {FIRST_STAGE: model.network, SECOND_STAGE: model.second}
    for name, network in networks.items():
        if network is None:
            continue
        weights = {key: value.float() for key, value in stages.get(name, {}).items()}
        try:
            network.load_state_dict(weights)
        except RuntimeError as error:
            reason = " ".join(str(error).split())[:200]
            raise WeightsError(f"{path}: weights do not fit their network ({reason})") from error
        network.eval()
    return model
