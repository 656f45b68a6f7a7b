"""``run.json``: what was run, on what, how it went, and under ``timing`` how fast."""

import hashlib
import json
import math
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np

from uasthn_cli.config import MAX_HASHED_BYTES
from uasthn_cli.outputs.formatting import iso_utc, safe_text
from uasthn_cli.types import Fix, FrameFile, FrameResult
from uasthn_cli.version import code_version

_MIB: Final = 1024.0 * 1024.0
_SAMPLES: Final = 64
_SAMPLE_BYTES: Final = 2**20


@dataclass(frozen=True, slots=True)
class RunTiming:
    """How long a run took: everything that differs between identical runs.

    ``stage_s`` holds seconds by stage, ``computed_frames`` the frames computed in this process
    (the others were read back from a journal), ``jobs`` how many were looked at at once, and
    ``cache_dir`` where map features are kept for later runs.
    """

    started_utc_s: float
    wall_s: float
    computed_frames: int
    stage_s: Mapping[str, float]
    jobs: int = 1
    cache_dir: Path | None = None


@dataclass(frozen=True, slots=True)
class RunRecord:
    """The sections of ``run.json`` that only the caller knows; mappings or dataclasses.

    ``arguments`` what shapes the result; ``time_base`` the chosen clock and why; ``frame_times``
    where the capture times came from; ``camera`` the camera used; ``inputs`` path and SHA-256 of
    log, frames, map, weights and truth; ``notes`` whatever else a reader should know;
    ``calibration`` by what answers were judged, ``flight`` what the whole flight taught.
    """

    arguments: Any
    time_base: Any
    frame_times: Any
    camera: Any
    inputs: Mapping[str, Any]
    timing: RunTiming
    notes: Mapping[str, Any] = field(default_factory=dict)
    calibration: Any = None
    flight: Mapping[str, Any] | None = None


def run_json(record: RunRecord, results: Sequence[FrameResult]) -> str:
    """Return the text of ``run.json``; all but ``timing`` is the same for identical runs."""
    sections = {
        "version": code_version(),
        "arguments": record.arguments,
        "time_base": record.time_base,
        "frame_times": record.frame_times,
        "camera": record.camera,
        "inputs": record.inputs,
        "calibration": record.calibration,
        "flight": record.flight,
        "counts": counts(results),
        "notes": record.notes,
        "timing": _timing_section(record.timing),
    }
    return json.dumps(plain(sections), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def counts(results: Sequence[FrameResult]) -> dict[str, Any]:
    """Return frames, frames with an estimate, accepted frames, and the others by reason."""
    reasons = Counter(result.reason.value for result in results if result.reason is not None)
    fixes = [result for result in results if isinstance(result, Fix)]
    return {
        "frames": len(results),
        "with_estimate": len(fixes),
        "accepted": sum(bool(fix.accepted) for fix in fixes),
        "reasons": dict(sorted(reasons.items())),
    }


def fingerprint_of(*sections: Any) -> str:
    """Return the SHA-256 of the code and of what shapes a run (arguments, input hashes)."""
    text = json.dumps([code_version(), *map(plain, sections)], sort_keys=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def file_sha256(path: Path | str) -> str | None:
    """Return the SHA-256 of a file, read in pieces; None for what is no readable plain file.

    A map may be anything that GDAL opens, a folder or an address among them.
    """
    try:
        with Path(path).open("rb") as handle:
            return hashlib.file_digest(handle, "sha256").hexdigest()
    except OSError:
        return None


def file_identity(path: Path) -> dict[str, Any]:
    """Return what tells a file from others: its SHA-256, or that of samples of a very large one.

    Of a large file also size and time of change are told, so that any ordinary change shows.
    """
    try:
        status = path.stat()
        if not path.is_file() or status.st_size <= MAX_HASHED_BYTES:
            return {"sha256": file_sha256(path)}
        return {
            "sha256": None,
            "sampled_sha256": _sampled_sha256(path, status.st_size),
            "size_bytes": status.st_size,
            "modified_utc": iso_utc(status.st_mtime),
        }
    except OSError:
        return {"sha256": None}


def _sampled_sha256(path: Path, size_bytes: int) -> str:
    """Return the SHA-256 of pieces spread evenly over a file, the first and last among them."""
    digest = hashlib.sha256()
    with path.open("rb") as handle:
        for start in np.linspace(0, size_bytes - _SAMPLE_BYTES, _SAMPLES).astype(np.int64):
            handle.seek(int(start))
            digest.update(handle.read(_SAMPLE_BYTES))
    return digest.hexdigest()


def frames_sha256(frames: Iterable[FrameFile]) -> str:
    """Return one SHA-256 over the names and contents of all frames, in their order.

    A frame that cannot be read counts by its name alone: it is a row with a reason, no error.
    """
    digest = hashlib.sha256()
    for frame in frames:
        entry = [frame.name, file_sha256(frame.path)]
        digest.update(json.dumps(entry).encode("ascii") + b"\n")
    return digest.hexdigest()


def peak_memory_mib() -> float | None:
    """Return the largest resident memory of this process so far; None where it is not known."""
    if sys.platform == "win32":
        return None
    import resource  # noqa: PLC0415 - does not exist on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / _MIB if sys.platform == "darwin" else peak / 1024.0


def plain(value: Any) -> Any:
    """Return a value in the types of JSON; numbers that are not finite become None.

    Raises:
        TypeError: a value of a type that has no place in a record.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, Mapping):
        return {safe_text(str(plain(key))): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return _plain_scalar(value)


def _plain_scalar(value: Any) -> Any:
    """Return a single value in a type of JSON."""
    if isinstance(value, PurePath | str):
        return safe_text(str(value))
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    raise TypeError(f"{type(value).__name__} has no place in a run record")


def _timing_section(timing: RunTiming) -> dict[str, Any]:
    """Return seconds, frames per second by stage, and peak memory."""
    frames = timing.computed_frames
    peak_mib = peak_memory_mib()
    return {
        "started_utc": iso_utc(timing.started_utc_s),
        "wall_s": round(timing.wall_s, 3),
        "computed_frames": frames,
        "jobs": timing.jobs,
        "cache": timing.cache_dir,
        "frames_per_s": _rate(frames, timing.wall_s),
        "stages": {
            name: {"seconds": round(seconds, 3), "frames_per_s": _rate(frames, seconds)}
            for name, seconds in timing.stage_s.items()
        },
        "peak_memory_mib": None if peak_mib is None else round(peak_mib, 1),
    }


def _rate(frames: int, seconds: float) -> float | None:
    """Return frames per second; None where nothing was timed."""
    return round(frames / seconds, 3) if seconds > 0 else None
