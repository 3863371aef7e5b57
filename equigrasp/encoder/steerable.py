"""phi(o, l) that turns with the scene by construction: a U-Net of regular fields of C_N."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.encoder.group_convolution import FieldNorm, GroupConvolution, regular_type, scalar_type, weigh
from equigrasp.encoder.image import check_image, check_widths, normalise


class SteerableUNet(nn.Module):
    """`UNet`, layer by layer, between fields of C_N: `(B, 4, H, W)`, `(B, D)` -> `(B, C, H / stride, W / stride)`.

    The observation and the features are scalars, all between are regular fields, and language enters as scalars
    that weigh the fields of the bottleneck. Turning the observation by 90 degrees turns the features as pixels, to
    rounding; so does moving it by multiples of 32 pixels, away from the border. In place of space-to-depth, whose
    channels C_8 does not permute, a 6 x 6 filter of stride 2 halves the image.

    Args:
        embedding_size: D.
        channels: C, features for each read-out cell.
        stride: 2 reads out at half resolution, 1 at full.
        widths: regular fields at 1/2, 1/4, 1/8, 1/16 and 1/32 of the resolution.
        group_order: N, a multiple of 4.

    Raises:
        InputError: if the stride is neither 1 nor 2, the widths are not five multiples of 8, or N is not one of 4.
    """

    def __init__(
        self,
        embedding_size: int,
        channels: int = 8,
        stride: int = 2,
        widths: tuple[int, ...] = (8, 16, 32, 72, 160),
        group_order: int = 4,
    ) -> None:
        super().__init__()
        check_widths(stride, widths)
        self.stride = stride
        self.group_order = group_order
        self.in_type = scalar_type(group_order, 4)
        self.out_type = fields.trivial_type(channels)
        types = [regular_type(group_order, width) for width in widths]
        self.stem = _layer(GroupConvolution(self.in_type, types[0], 6, "halve"))
        self.down = nn.ModuleList(_layer(GroupConvolution(a, b)) for a, b in itertools.pairwise(types))
        self.language = nn.Linear(embedding_size, widths[-1])
        self.fuse = GroupConvolution(types[-1] + types[-1], types[-1], 1)
        self.bottom = _layer(GroupConvolution(types[-1], types[-1]))
        ascending = types[::-1]
        self.project = nn.ModuleList(GroupConvolution(a, b, 1) for a, b in itertools.pairwise(ascending))
        self.up = nn.ModuleList(_layer(GroupConvolution(each, each)) for each in ascending[1:])
        features = scalar_type(group_order, channels)
        size, resample = (3, "same") if stride == 2 else (6, "double")
        self.out = GroupConvolution(types[0], features, size, resample)
        self.offset = nn.Parameter(torch.zeros(channels))

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """Colour 0 .. 255 and height in metres, `(B, 4, H, W)`, and the unit embedding `(B, D)` -> features."""
        check_image(observation)
        x = self.stem(normalise(observation).contiguous(memory_format=torch.channels_last))
        skips = []
        for layer in self.down:
            skips.append(x)
            x = layer(functional.max_pool2d(x, 2))
        weights = self.language(embedding * math.sqrt(embedding.shape[1]))
        x = self.bottom(x + self.fuse(torch.cat([x, weigh(x, weights)], dim=1)))
        for project, layer, skip in zip(self.project, self.up, reversed(skips), strict=True):
            x = functional.interpolate(project(x), scale_factor=2, mode="bilinear", align_corners=False)
            x = layer(x + skip)
        return self.out(x) + self.offset[:, None, None]


def _layer(convolution: GroupConvolution) -> nn.Sequential:
    return nn.Sequential(convolution, FieldNorm(convolution.out_type), nn.ReLU(inplace=True))
