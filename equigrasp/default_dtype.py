"""Torch's default dtype, which is one for the whole process and a user's to choose."""

from __future__ import annotations

import contextlib
from collections.abc import Generator

import torch


@contextlib.contextmanager
def in_float32() -> Generator[None]:
    """Let torch's default dtype be float32 meanwhile, for all threads."""
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float32)
    try:
        yield
    finally:
        torch.set_default_dtype(before)
