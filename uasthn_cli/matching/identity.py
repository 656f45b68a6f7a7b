"""What features are made by, in one line: equal lines mean equal features of equal windows."""

import hashlib
import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import torch

from uasthn_cli.matching.networks import XcorrModel


def weights_sha256(models: Sequence[XcorrModel]) -> str:
    """Return a hash of networks: their architecture and every number in them, in order."""
    hashed = hashlib.sha256()
    for model in models:
        hashed.update(json.dumps(model.architecture.as_metadata(), sort_keys=True).encode())
        for name, value in sorted(model.state_dict().items()):
            hashed.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
            hashed.update(value.detach().cpu().contiguous().numpy().tobytes())
    return hashed.hexdigest()


@cache
def code_sha256() -> str:
    """Return a hash of this room's code and of the versions of what computes for it.

    Whoever changes an encoder need not remember to say so.
    """
    versions = (torch.__version__, np.__version__, cv2.__version__)
    hashed = hashlib.sha256(repr(versions).encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        hashed.update(path.name.encode() + b"\0" + path.read_bytes())
    return hashed.hexdigest()


def arithmetic(device: torch.device) -> str:
    """Return where and how numbers are computed now: it shows in their last digits.

    On a CPU convolutions are summed in an order that depends on the number of threads.
    """
    precision = torch.get_float32_matmul_precision()
    if device.type == "cuda":
        backend = torch.backends.cudnn
        settings = (backend.allow_tf32, backend.deterministic, precision)
        return f"{torch.cuda.get_device_name(device)} {settings}"
    capability = torch.backends.cpu.get_cpu_capability()
    return f"{device.type} {capability} {torch.get_num_threads()} threads {precision}"
