"""Examples as the tensors of a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from equigrasp.augmentation import Example
from equigrasp.policy import GraspPolicy, to_tensor
from equigrasp.workspace import WORKSPACE


def collate(
    policy: GraspPolicy, examples: Sequence[Example], embeddings: Mapping[str, Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """Examples as a batch: observations `(B, 4, H, W)`, embeddings `(B, D)`, labels `(B,)` into the read-out."""
    read_out = policy.read_out(WORKSPACE.shape)
    return (
        torch.stack([to_tensor(each.observation) for each in examples]),
        torch.stack([embeddings[each.instruction] for each in examples]),
        torch.tensor([read_out.label(each.grasp) for each in examples]),
    )
