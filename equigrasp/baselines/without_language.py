"""A kernel and a phi that are not told the instruction: one trained vector stands in for it (LEG, Table 4).

They wrap any kernel and any phi, which then has the same layers, and differs in what it is told alone.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp.fields import FieldType


class KernelWithoutLanguage(nn.Module):
    """The same kernel for every instruction: `(B, D)` -> `(B, out_type.size, C, k, k)`.

    Args:
        kernel: with `in_type` and `out_type`, as those of `equigrasp.kernel`.
        embedding_size: D, of what the kernel was made for.
    """

    def __init__(self, kernel: nn.Module, embedding_size: int) -> None:
        super().__init__()
        self.kernel = kernel
        self.in_type: FieldType = kernel.in_type  # ty: ignore[invalid-assignment]
        self.out_type: FieldType = kernel.out_type  # ty: ignore[invalid-assignment]
        self.size: int | None = getattr(kernel, "size", None)
        self.even: bool = getattr(kernel, "even", False)
        self.vector = nn.Parameter(_unit_vector(embedding_size))

    def forward(self, embedding: Tensor) -> Tensor:
        """The embedding says how many, and nothing else."""
        return self.kernel(self.vector[None]).expand(len(embedding), -1, -1, -1, -1)


class PhiWithoutLanguage(nn.Module):
    """The same features for every instruction: `(B, 4, H, W)`, `(B, D)` -> `(B, C, H / stride, W / stride)`.

    Args:
        phi: with `stride` and `out_type`, as those of `equigrasp.encoder`.
        embedding_size: D, of what phi was made for.
    """

    def __init__(self, phi: nn.Module, embedding_size: int) -> None:
        super().__init__()
        self.phi = phi
        self.stride = int(phi.stride)  # ty: ignore[invalid-argument-type]
        self.out_type: FieldType = phi.out_type  # ty: ignore[invalid-assignment]
        self.reach: float | None = getattr(phi, "reach", None)
        self.vector = nn.Parameter(_unit_vector(embedding_size))

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """The embedding is not looked at."""
        return self.phi(observation, self.vector.expand(len(observation), -1))


def _unit_vector(size: int) -> Tensor:
    return functional.normalize(torch.randn(size), dim=0)
