"""Where networks run."""

import ctypes
import logging
import sys

_log = logging.getLogger(__name__)

_DRIVERS = ("nvcuda.dll",) if sys.platform == "win32" else ("libcuda.so.1", "libamdhip64.so")
"""Libraries without which torch finds no GPU: looked for first, for loading torch takes seconds."""


def choose_device(requested: str) -> str:
    """Return ``cuda`` or ``cpu``: the GPU when asked for or, with ``auto``, when there is one.

    A GPU asked for but absent falls back to the CPU with a warning.
    """
    if requested == "cpu" or (requested == "auto" and not _has_driver()):
        return "cpu"
    import torch  # noqa: PLC0415 - heavy, and not needed where there is no GPU

    if torch.cuda.is_available():
        return "cuda"
    if requested == "cuda":
        _log.warning("no CUDA device found; using the CPU")
    return "cpu"


def _has_driver() -> bool:
    for name in _DRIVERS:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False
