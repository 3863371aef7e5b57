"""What a phi refuses, a stride, widths or a picture that it is not made for, and how colour and height are scaled."""

from __future__ import annotations

import torch
from torch import Tensor

from equigrasp.errors import InputError

MULTIPLE = 32
"""Rows and columns of an observation are multiples of this: five halvings."""
HALVINGS = {2: "once", MULTIPLE: "five times"}
"""How often, for each multiple, in words."""


def check_widths(stride: int, widths: tuple[int, ...]) -> None:
    """Raise an InputError unless a U-Net can have this stride and these widths."""
    check_stride(stride)
    if len(widths) != 5 or any(w % 8 or w < 8 for w in widths):
        raise InputError(f"a U-Net has five widths, multiples of 8, but these are {widths}")


def check_stride(stride: int) -> None:
    """Raise an InputError unless a U-Net can read out at this stride."""
    if stride not in (1, 2):
        raise InputError(f"a U-Net reads out at stride 1 or 2, but this is {stride}")


def check_image(observation: Tensor, multiple: int = MULTIPLE) -> None:
    """Raise an InputError unless this is `(B, 4, H, W)`, with H and W multiples of a power of two."""
    if observation.ndim != 4 or observation.shape[1] != 4:
        raise InputError(f"an observation is (B, 4, H, W), colour and height, but this is {tuple(observation.shape)}")
    rows, columns = observation.shape[2:]
    if rows % multiple or columns % multiple or not rows or not columns:
        raise InputError(
            f"the U-Net halves the heightmap {HALVINGS[multiple]}, so its sides are multiples of {multiple}, but this "
            f"is {rows} x {columns}; crop it or pad it with bare table"
        )


def normalise(observation: Tensor) -> Tensor:
    """Colour 0 .. 255 to -0.5 .. 0.5 and metres to decimetres, of order one and near zero for a bare table."""
    # numbers and no tensor of them, which would have to come from the host at every step
    return torch.cat([observation[:, :3] * (1 / 255) - 0.5, observation[:, 3:] * 10.0], dim=1)
