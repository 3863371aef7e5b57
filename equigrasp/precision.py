"""Number formats that a policy's convolutions are computed in, and what `auto` means on a machine."""

from __future__ import annotations

import torch

PRECISIONS = ("auto", "float32", "bfloat16")
NATIVE = ("_is_amx_tile_supported", "_is_avx512_bf16_supported")
"""torch's questions to a processor: each yes is an instruction that multiplies bfloat16 faster than float32."""


def multiplies_bfloat16(precision: str, device: str) -> bool:
    """Whether to run convolutions in bfloat16: as told, or as the hardware multiplies it.

    `auto` is bfloat16 on CUDA, and on processors with AMX or AVX-512's own bfloat16 (Intel since Cooper Lake, AMD since
    Zen 4), where whole steps take 0.64 to 0.98 of float32's time (docs/speed.md); anywhere else bfloat16 is emulated,
    and takes several times as long.
    """
    if precision == "auto":
        return device == "cuda" or (device == "cpu" and any(getattr(torch.cpu, each, _no)() for each in NATIVE))
    return precision == "bfloat16"


def _no() -> bool:
    return False
