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
from equigrasp.encoder.image import check_image, check_widths, normalise


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


class GroupNorm(nn.GroupNorm):
    """Group normalisation in its weights' dtype, where the convolution before it gives bfloat16 by autocast.

    So autocast has it on CUDA. On processors torch's own in bfloat16 takes three times as long.
    """

    def forward(self, input: Tensor) -> Tensor:
        """The same shape, in the weights' dtype."""
        return super().forward(input.to(self.weight.dtype))


def convolution(inputs: int, outputs: int) -> nn.Sequential:
    """3x3 convolution, group normalisation, ReLU; the resolution stays."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1, bias=False),
        GroupNorm(8, outputs),
        nn.ReLU(inplace=True),
    )
