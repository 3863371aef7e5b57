"""What kernels refuse: sizes too small or without a centre pixel, no embeddings, features of no fit or other dtype."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from equigrasp.errors import InputError

SMALLEST = 5
"""Pixels: of three, the soft disc of a lifted kernel leaves one, which is the same at every angle."""


def check_size(size: int) -> None:
    """Raise an InputError unless the kernel has room and a centre pixel: an even size is off centre by half a pixel."""
    if size < SMALLEST:
        raise InputError(
            f"a kernel of {size} pixels a side has no room to tell angles apart; use an odd size of {SMALLEST} or more"
        )
    if size % 2 == 0:
        raise InputError(
            f"a kernel turns about its centre pixel, so its size is odd, but this is {size}; "
            f"use {size - 1} or {size + 1}"
        )


def check_embedding(embedding: Tensor, width: int) -> None:
    """Raise an InputError unless these are embeddings `(B, width)` of a floating dtype."""
    if embedding.ndim != 2 or embedding.shape[1] != width:
        raise InputError(
            f"this module was made for embeddings (B, {width}), but this is {tuple(embedding.shape)}; "
            "give it the width of your text encoder"
        )
    if not embedding.is_floating_point():
        raise InputError(f"embeddings are of a floating dtype, but this is {embedding.dtype}; use embedding.float()")


def dtype_of(module: nn.Module) -> torch.dtype | None:
    """That of its first weight of a floating dtype; None where it has none."""
    return next((each.dtype for each in module.parameters() if each.is_floating_point()), None)


def check_dtypes(phi: nn.Module, kappa: nn.Module) -> None:
    """Raise an InputError if the weights of phi and of kappa, which hear the same embedding, are of two dtypes."""
    seen, heard = dtype_of(phi), dtype_of(kappa)
    if seen and heard and seen != heard:
        raise InputError(
            f"phi's weights are {seen} and kappa's are {heard}, but both hear the same embedding; give them one dtype, "
            "as kappa.float() does"
        )


def check_fit(features: Tensor, kernel: Tensor, batch: int, outputs: int) -> None:
    """Raise an InputError unless features `(batch, C, h, w)` meet kernels `(batch, outputs, C, k, k)` with an odd k."""
    if features.ndim != 4 or len(features) != batch:
        raise InputError(
            f"phi's features are (B, C, H / stride, W / stride) with B = {batch} here, but these are "
            f"{tuple(features.shape)}; make one map for each scene"
        )
    channels, side = features.shape[1], kernel.shape[-1] if kernel.ndim else 0
    if tuple(kernel.shape) != (batch, outputs, channels, side, side) or side % 2 == 0:
        raise InputError(
            f"kappa's kernels are ({batch}, {outputs}, {channels}, k, k), k odd, for {batch} scenes, {outputs} outputs "
            f"and phi's {channels} channels, but these are {tuple(kernel.shape)}; make phi and kappa for each other"
        )
