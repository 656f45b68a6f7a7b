"""What is finished of a frame as one line of JSON and back, every float exactly as it was.

Python writes a float as the shortest decimal that reads back as the same float, and writes NaN and
infinities as ``NaN`` and ``Infinity``, which it also reads. Likelihoods are whole levels, packed.
"""

import base64
import json
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from uasthn_cli.types import (
    Attitude,
    CameraModel,
    Fix,
    FloatArray,
    FrameFailure,
    FrameFile,
    FrameResult,
    Located,
    OffsetLikelihood,
    Prior,
    Reason,
    RefinedFrame,
    Source,
    Trust,
)


def encode_located(located: Located) -> str:
    """Return what a frame gave alone as one line of ASCII JSON without a line end."""
    result = located.result
    return json.dumps(
        {
            "kind": "fix" if isinstance(result, Fix) else "failure",
            "result": asdict(result),
            "likelihood": _packed(located.likelihood),
        },
        default=_plain,
    )


def decode_located(line: str | bytes) -> Located:
    """Return what :func:`encode_located` wrote.

    Raises:
        ValueError: the line is torn, or of another version of the program.
    """
    try:
        entry = json.loads(line)
        fields = entry["result"]
        result: FrameResult = _fix(fields) if entry["kind"] == "fix" else _failure(fields)
        return Located(result, _unpacked(entry["likelihood"]))
    except (KeyError, TypeError, AttributeError, zlib.error) as error:
        raise ValueError(f"not a result of this version: {error}") from error


def encode_refined_frame(refined: RefinedFrame) -> str:
    """Return a refined frame as one line of ASCII JSON without a line end."""
    camera = None if refined.camera is None else asdict(refined.camera)
    entry = {
        "frame": asdict(refined.frame),
        "camera": camera,
        "likelihood": _packed(refined.likelihood),
    }
    return json.dumps(entry, default=_plain)


def decode_refined_frame(line: str | bytes) -> RefinedFrame:
    """Return what :func:`encode_refined_frame` wrote.

    Raises:
        ValueError: the line is torn, or of another version of the program.
    """
    try:
        entry = json.loads(line)
        camera = entry["camera"]
        if camera is not None:
            camera = CameraModel(**(camera | {"distortion": tuple(camera["distortion"])}))
        return RefinedFrame(_frame(entry["frame"]), camera, _unpacked(entry["likelihood"]))
    except (KeyError, TypeError, AttributeError, zlib.error) as error:
        raise ValueError(f"not a refined frame of this version: {error}") from error


def _plain(value: Any) -> Any:
    """Return what JSON knows for what it does not know."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no place in a result")


def _packed(likelihood: OffsetLikelihood | None) -> dict[str, Any] | None:
    if likelihood is None:
        return None
    packed = zlib.compress(np.ascontiguousarray(likelihood.levels).tobytes(), 1)
    return {
        "size": len(likelihood.levels),
        "cell_m": likelihood.cell_m,
        "centre_m": likelihood.centre_m,
        "levels": base64.b64encode(packed).decode("ascii"),
    }


def _unpacked(entry: dict[str, Any] | None) -> OffsetLikelihood | None:
    if entry is None:
        return None
    content = zlib.decompress(base64.b64decode(entry["levels"], validate=True))
    levels = np.frombuffer(content, dtype=np.uint8).reshape(entry["size"], entry["size"])
    centre_m = np.array(entry["centre_m"], dtype=np.float64)
    return OffsetLikelihood(levels.copy(), entry["cell_m"], centre_m)


def _failure(values: dict[str, Any]) -> FrameFailure:
    prior = values["prior"]
    parts = {
        "reason": Reason(values["reason"]),
        "prior": None if prior is None else _prior(prior),
        "frame": _frame(values["frame"]),
    }
    return FrameFailure(**(values | parts))


def _fix(values: dict[str, Any]) -> Fix:
    reason, single = values["reason"], values["single"]
    covariance = _square(values["trust"]["covariance_m2"])
    parts = {
        "prior": _prior(values["prior"]),
        "reason": None if reason is None else Reason(reason),
        "source": Source(values["source"]),
        "corners_deg": np.array(values["corners_deg"], dtype=np.float64).reshape(4, 2),
        "corner_std_m": np.array(values["corner_std_m"], dtype=np.float64).reshape(4, 2),
        "trust": Trust(**(values["trust"] | {"covariance_m2": covariance})),
        "camera_covariance_m2": _square(values["camera_covariance_m2"]),
        "single": None if single is None else _fix(single),
    }
    return Fix(**(values | parts))


def _square(values: list[list[float]]) -> FloatArray:
    """Return a covariance ``(2, 2)``."""
    return np.array(values, dtype=np.float64).reshape(2, 2)


def _prior(values: dict[str, Any]) -> Prior:
    """Return a prior with its frame and attitude."""
    parts = {"frame": _frame(values["frame"]), "attitude": Attitude(**values["attitude"])}
    return Prior(**(values | parts))


def _frame(values: dict[str, Any]) -> FrameFile:
    """Return a frame file."""
    return FrameFile(name=values["name"], path=Path(values["path"]))
