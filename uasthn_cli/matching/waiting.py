"""Wait for what runs beside the program, so that a clock tells the truth."""

import sys


def wait_for_gpu() -> None:
    """Return once the GPU has done all that was asked of it; at once where none is in use.

    Kernels run on after the call that launched them. An estimator without torch has nothing to
    wait for, so torch is not loaded for this.
    """
    torch = sys.modules.get("torch")
    if torch is not None and torch.cuda.is_initialized():
        torch.cuda.synchronize()
