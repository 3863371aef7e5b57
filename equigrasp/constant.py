"""A constant tensor that a module carries: sampled once in float64, rounded once, to the dtype in use."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn


class Constant(nn.Module):
    """`value` is a tensor that no training changes and no state dict holds.

    A plain buffer made in float32 stays rounded when its module becomes float64, and a symmetry that should then
    hold to 1e-12 holds to 1e-7. This one is rounded anew, from the exact values, whenever the dtype changes.

    Args:
        exact: any shape, float64.
    """

    value: Tensor

    def __init__(self, exact: Tensor) -> None:
        super().__init__()
        self._exact = exact.detach()
        self.register_buffer("value", self._exact.to(torch.get_default_dtype()), persistent=False)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Constant:
        before = self.value.dtype
        super()._apply(fn, recurse)
        if self.value.dtype != before:
            self.value = self._exact.to(self.value)
        return self
