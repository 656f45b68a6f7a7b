"""Where tensors live."""

import logging

import torch

_log = logging.getLogger(__name__)


def choose_device(requested: str) -> str:
    """Return ``cuda`` or ``cpu``: the GPU when asked for or, with ``auto``, when there is one.

    A GPU asked for but absent falls back to the CPU with a warning.
    """
    if requested == "cpu":
        return "cpu"
    if torch.cuda.is_available():
        return "cuda"
    if requested == "cuda":
        _log.warning("no CUDA device found; using the CPU")
    return "cpu"
