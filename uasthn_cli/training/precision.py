"""In which precision networks train fastest."""

import torch

from uasthn_cli.config import Precision


def use_bfloat16(precision: Precision, device: str) -> bool:
    """Tell whether to train in bfloat16: as asked or, with ``auto``, where hardware has it.

    CPUs without bfloat16 instructions emulate them, slower than float32.
    """
    if precision is not Precision.AUTO:
        return precision is Precision.BFLOAT16
    if device == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    capabilities = (
        getattr(torch.cpu, name, None)  # private: not in every version
        for name in ("_is_avx512_bf16_supported", "_is_amx_tile_supported")
    )
    has_instructions = any(capability() for capability in capabilities if capability is not None)
    has_library: bool = torch.backends.mkldnn.is_available()  # type: ignore[no-untyped-call]
    return has_instructions and has_library
