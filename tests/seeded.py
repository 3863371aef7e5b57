"""A module whose first weights are the same each time, whatever was drawn before."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import torch
from torch import nn

M = TypeVar("M", bound=nn.Module)


def made(kind: Callable[..., M], *args: Any, seed: int = 0, **settings: Any) -> M:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return kind(*args, **settings)
