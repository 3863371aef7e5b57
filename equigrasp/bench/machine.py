"""The machine: what it is, how busy, and what it does at its best, as a yardstick that is timed beside the work."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from typing import Any

import torch

import equigrasp
from equigrasp.provenance import processor

CHANNELS, ROWS, COLUMNS = 256, 80, 160
CONVOLUTION_FLOPS = 2 * 9 * CHANNELS**2 * ROWS * COLUMNS
"""Of one `convolution`: a multiplication and an addition for each weight and pixel."""
COPIED_BYTES = 2 * 2**26
"""That one `memory_copy` moves: 64 MiB are read and 64 MiB written."""


def describe(threads: int) -> dict[str, Any]:
    """What a reader needs to know of this machine to compare figures."""
    return {
        "processor": processor(),
        "system": f"{platform.system()} {platform.machine()}",
        "cores": os.cpu_count(),
        "threads": threads,
        "load": load(),
        "equigrasp": equigrasp.__version__,
        "torch": torch.__version__,
        "python": platform.python_version(),
    }


def load() -> float | None:
    """Processes that wanted a core in the last minute, on average; None where the system does not say."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


def convolution(dtype: torch.dtype) -> Callable[[], object]:
    """A large 3x3 convolution, forward, in the layout that networks here use: the most that a layer can reach."""
    generator = torch.Generator().manual_seed(0)
    image = torch.randn(1, CHANNELS, ROWS, COLUMNS, generator=generator).to(dtype)
    weight = torch.randn(CHANNELS, CHANNELS, 3, 3, generator=generator).to(dtype)
    image, weight = (each.contiguous(memory_format=torch.channels_last) for each in (image, weight))

    @torch.inference_mode()
    def run() -> object:
        return torch.nn.functional.conv2d(image, weight, padding=1)

    return run


def memory_copy() -> Callable[[], object]:
    """A copy of 64 MiB, more than any cache holds."""
    source = torch.ones(COPIED_BYTES // 8)
    target = torch.empty_like(source)
    return lambda: target.copy_(source)
