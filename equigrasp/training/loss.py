"""The loss: the cross-entropy of one labelled grasp among all cells and bins of a read-out."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


def loss_of(logits: Tensor, labels: Tensor) -> Tensor:
    """The cross-entropy of the labelled cell and bin over all of the read-out, the batch's mean.

    torch's own walks a scene's scores on one thread, or in one block of threads on a GPU, because they are one row, of
    1.8 million at full resolution. Here each pass is of all threads, and the softmax that the gradient needs is the
    forward pass's own. It cannot be differentiated again, nor the same loss a second time.

    Args:
        logits: `(B, bins, rows, columns)`.
        labels: `(B,)`, each the place of a grasp among all scores of its scene, flattened.

    Returns:
        A scalar.
    """
    return _CrossEntropy.apply(logits, labels)


class _CrossEntropy(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, logits: Tensor, labels: Tensor) -> Tensor:
        """As `loss_of`."""
        scores = logits.flatten(1)
        greatest = scores.amax(1, keepdim=True)
        exponentials = (scores - greatest).exp_()
        total = exponentials.sum(1, keepdim=True)
        ctx.save_for_backward(exponentials, total, labels)
        ctx.shape = logits.shape
        return (total.log() + greatest - scores.gather(1, labels[:, None])).mean()

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        """The softmax less one at the label, in the exponentials' memory."""
        exponentials, total, labels = ctx.saved_tensors
        share = gradient / len(labels)
        by_scores = exponentials.mul_(share / total)
        at = labels[:, None]
        by_scores.scatter_(1, at, by_scores.gather(1, at) - share)
        return by_scores.view(ctx.shape), None
