"""phi(o, l): from an observation and an instruction to a field of scalar features.

`UNet` is plain: it does not turn with the scene by construction, it learns to (LEG-UNet). What the theory needs
of it is that an object's features move with the object, and augmentation by SE(2) teaches that.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.errors import InputError

MULTIPLE = 32
"""Rows and columns of an observation are multiples of this: five halvings."""
HALVINGS = {2: "once", MULTIPLE: "five times"}
"""How often, for each multiple, in words."""


class UNet(nn.Module):
    """A U-Net with the instruction at its bottleneck: `(B, 4, H, W)`, `(B, D)` -> `(B, C, H / stride, W / stride)`.

    Space-to-depth halves the image before the first convolution, so that no layer works at full resolution: half
    of such a network's time went into normalising and resizing there. Skips are added after a 1x1 convolution
    that runs before the upsampling, where pixels are a quarter as many.

    Args:
        embedding_size: D.
        channels: C, features for each read-out cell.
        stride: 2 reads out at half resolution, 1 at full (depth-to-space at the end).
        widths: channels at 1/2, 1/4, 1/8, 1/16 and 1/32 of the resolution.

    Raises:
        InputError: if the stride is neither 1 nor 2, or the widths are not five multiples of 8.
    """

    def __init__(
        self,
        embedding_size: int,
        channels: int = 8,
        stride: int = 2,
        widths: tuple[int, ...] = (24, 48, 96, 192, 256),
    ) -> None:
        super().__init__()
        check_widths(stride, widths)
        self.stride = stride
        self.out_type = fields.trivial_type(channels)
        self.stem = convolution(16, widths[0])
        self.down = nn.ModuleList(convolution(a, b) for a, b in itertools.pairwise(widths))
        self.language = nn.Linear(embedding_size, widths[-1])
        self.fuse = nn.Conv2d(2 * widths[-1], widths[-1], 1)
        self.bottom = convolution(widths[-1], widths[-1])
        ascending = widths[::-1]
        self.project = nn.ModuleList(nn.Conv2d(a, b, 1, bias=False) for a, b in itertools.pairwise(ascending))
        self.up = nn.ModuleList(convolution(width, width) for width in ascending[1:])
        self.out = nn.Conv2d(widths[0], channels * (2 // stride) ** 2, 3, padding=1)
        # weights in the images' layout: else every convolution reorders its own, forwards and backwards
        self.to(memory_format=torch.channels_last)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """Colour 0 .. 255 and height in metres, `(B, 4, H, W)`, and the unit embedding `(B, D)` -> features."""
        check_image(observation)
        x = functional.pixel_unshuffle(normalise(observation), 2).contiguous(memory_format=torch.channels_last)
        x = self.stem(x)
        skips = []
        for layer in self.down:
            skips.append(x)
            x = layer(functional.max_pool2d(x, 2))
        language = self.language(embedding * math.sqrt(embedding.shape[1]))[:, :, None, None]
        x = self.bottom(x + self.fuse(torch.cat([x, x * language], dim=1)))
        for project, layer, skip in zip(self.project, self.up, reversed(skips), strict=True):
            x = functional.interpolate(project(x), scale_factor=2, mode="bilinear", align_corners=False)
            x = layer(x + skip)
        x = self.out(x)
        return functional.pixel_shuffle(x, 2) if self.stride == 1 else x


def convolution(inputs: int, outputs: int) -> nn.Sequential:
    """3x3 convolution, group normalisation, ReLU; the resolution stays."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1, bias=False),
        nn.GroupNorm(8, outputs),
        nn.ReLU(inplace=True),
    )


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
