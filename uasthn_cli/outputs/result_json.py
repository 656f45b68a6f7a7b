"""A frame's result as one line of JSON and back, every float exactly as it was.

Python writes a float as the shortest decimal that reads back as the same float, and writes NaN and
infinities as ``NaN`` and ``Infinity``, which it also reads.
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from uasthn_cli.types import (
    Attitude,
    Fix,
    FrameFailure,
    FrameFile,
    FrameResult,
    Prior,
    Reason,
)


def encode_result(result: FrameResult) -> str:
    """Return a result as one line of ASCII JSON without a line end."""
    kind = "fix" if isinstance(result, Fix) else "failure"
    return json.dumps({"kind": kind, "result": asdict(result)}, default=_plain)


def decode_result(line: str | bytes) -> FrameResult:
    """Return the result that :func:`encode_result` wrote.

    Raises:
        ValueError: the line is torn, or of another version of the program.
    """
    try:
        entry = json.loads(line)
        fields = _fields(entry["result"])
        return Fix(**fields) if entry["kind"] == "fix" else FrameFailure(**fields)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"not a result of this version: {error}") from error


def _plain(value: Any) -> Any:
    """Return what JSON knows for what it does not know."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no place in a result")


def _fields(values: dict[str, Any]) -> dict[str, Any]:
    """Give the fields of a result their types back."""
    fields = dict(values)
    fields["reason"] = None if fields["reason"] is None else Reason(fields["reason"])
    fields["prior"] = None if fields["prior"] is None else _prior(fields["prior"])
    if "frame" in fields:
        fields["frame"] = _frame(fields["frame"])
    for name in ("corners_deg", "corner_std_m"):
        if name in fields:
            fields[name] = np.array(fields[name], dtype=np.float64).reshape(4, 2)
    return fields


def _prior(values: dict[str, Any]) -> Prior:
    """Return a prior with its frame and attitude."""
    parts = {"frame": _frame(values["frame"]), "attitude": Attitude(**values["attitude"])}
    return Prior(**(values | parts))


def _frame(values: dict[str, Any]) -> FrameFile:
    """Return a frame file."""
    return FrameFile(name=values["name"], path=Path(values["path"]))
