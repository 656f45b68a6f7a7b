"""Save and resume a training run: model, optimiser and step, whole or not at all."""

import io
import pickle
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch

from uasthn_cli.errors import TrainingDataError
from uasthn_cli.outputs.atomic import write_bytes
from uasthn_cli.training.engine import PARTS

XCORR_OPTIONS: Final = {
    "seed": "--seed",
    "learning_rate": "--learning-rate",
    "samples.windows": "--windows",
    "samples.canvases": "--canvases",
    "data": "--images or --sand-share (or the images have changed)",
    "architecture.widths": "--widths",
    "architecture.feature_channels": "--channels",
    "initial": "--init",
    "teacher": "--teacher",
    **{f"samples.engine.{part.replace('-', '_')}": f"--without {part}" for part in PARTS},
}
"""How settings of ``uasthn train`` for ``xcorr`` are typed."""

_FREE: Final = ("steps", "device", "bfloat16", "workers", "checkpoint_every", "changes")
_SAID: Final = ("steps", "device", "bfloat16")


@dataclass(frozen=True, slots=True)
class TrainingState:
    """What a killed run needs to go on as if nothing had happened.

    ``model`` holds weights and batch-norm statistics, ``optimiser`` AdamW's moments. No random
    state is needed: batches are made from seed and number.
    """

    step: int
    model: dict[str, Any]
    optimiser: dict[str, Any]
    settings: dict[str, Any]


def save_checkpoint(path: Path, state: TrainingState) -> None:
    """Write a checkpoint whole or not at all.

    Raises:
        OutputError: it cannot be written; the one before stays.
    """
    content = {
        "step": state.step,
        "model": state.model,
        "optimiser": state.optimiser,
        "settings": state.settings,
    }
    buffer = io.BytesIO()
    torch.save(content, buffer)
    write_bytes(path, buffer.getvalue())


def load_checkpoint(path: Path) -> TrainingState:
    """Read a checkpoint without running any code in it.

    Raises:
        TrainingDataError: the file is not a checkpoint of this tool.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        if not isinstance(content, dict):
            raise TypeError("not a dictionary")
        return TrainingState(
            int(content["step"]),
            content["model"],
            content["optimiser"],
            dict(content["settings"]),
        )
    except (
        OSError,
        RuntimeError,
        LookupError,
        TypeError,
        ValueError,
        EOFError,
        pickle.UnpicklingError,
    ) as error:
        raise TrainingDataError(
            f"{path}: not a checkpoint to resume from; delete it to start anew"
        ) from error


def require_same_run(
    path: Path,
    saved: dict[str, Any],
    wanted: dict[str, Any],
    written_as: Mapping[str, str] = XCORR_OPTIONS,
) -> None:
    """Check that going on with other settings would end where an unbroken run ends.

    ``written_as`` gives settings, by their dotted names, the names of the command's options.
    Settings that a checkpoint does not know (it was written by an older version) are not compared.

    Raises:
        TrainingDataError: they differ in more than length, place of computation or pace of saving.
    """
    saved_flat, wanted_flat = dict(_flatten(saved)), dict(_flatten(wanted))
    for name in sorted(saved_flat.keys() & wanted_flat.keys()):
        if name in _FREE or saved_flat[name] == wanted_flat[name]:
            continue
        is_digest = name in ("data", "initial", "teacher", "generator")
        values = (
            "" if is_digest else f" ({_said(saved_flat[name])}, now {_said(wanted_flat[name])})"
        )
        raise TrainingDataError(
            f"{path}: was begun with another {written_as.get(name, name)}{values}; give the same"
            " again, choose another --out, or delete the checkpoint to start anew"
        )


def changes_on_resume(step: int, saved: dict[str, Any], wanted: dict[str, Any]) -> list[str]:
    """Return the history of changed settings, what changes at ``step`` included, as sentences."""
    return list(saved.get("changes", [])) + [
        f"from step {step}: {name} {wanted[name]} instead of {saved[name]}"
        for name in _SAID
        if name in saved and saved[name] != wanted[name]
    ]


def _said(value: Any) -> Any:
    """Return a value as a message names it."""
    return ("off", "on")[value] if isinstance(value, bool) else value


def _flatten(settings: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in settings.items():
        if isinstance(value, dict):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", tuple(value) if isinstance(value, list) else value
