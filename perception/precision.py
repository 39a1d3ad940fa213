"""In which precision networks compute: where bfloat16 is faster, and where it only looks so."""

from __future__ import annotations

import torch

from .training_config import TrainingConfig


def resolved_precision(precision: str, device: torch.device | None = None) -> str:
    """``"fp32"`` or ``"bf16"``: the one asked for, or with ``"auto"`` the faster one.

    Args:
        precision: One of ``TrainingConfig.precisions``.
        device: Where the network computes; the CPU if None.

    Raises:
        ValueError: There is no such precision.

    >>> resolved_precision("fp32")
    'fp32'
    """
    known = TrainingConfig.precisions
    if precision not in known:
        raise ValueError(f"precision must be one of {', '.join(known)}, got {precision!r}")
    if precision == "auto":
        return "bf16" if bf16_pays_off(device) else "fp32"
    return precision


def bf16_pays_off(device: torch.device | None = None) -> bool:
    """Whether networks are faster in bfloat16: on GPUs that have it, and on processors with AMX.

    AVX-512 has instructions for bfloat16, too, but no faster ones; with them alone, converting
    makes it slower than single precision.
    """
    kind = "cpu" if device is None else device.type
    if kind == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    supported = getattr(torch.cpu, "_is_amx_tile_supported", None)
    return kind == "cpu" and supported is not None and bool(supported())
