"""What every kernel refuses: a size without a centre pixel, embeddings of another width or of whole numbers."""

from __future__ import annotations

from torch import Tensor

from equigrasp.errors import InputError


def check_size(size: int) -> None:
    """Raise an InputError unless the kernel has a centre pixel: an even size is off centre by half a pixel."""
    if size % 2 == 0 or size < 1:
        raise InputError(
            f"a kernel turns about its centre pixel, so its size is odd, but this is {size}; "
            f"use {size - 1 if size > 1 else 1} or {size + 1}"
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
