"""phi(o, l) that turns with each object alone: `SteerableUNet` without what is global in it.

Eq. 2 moves one object among others that stay. phi follows if no feature sees more than one of them, so its field of
view must end, at a distance that is known, and nothing may be averaged over the image. So there are no pools: the
coarse scales of a U-Net become dilations, and normalisation is cell by cell. What is left of the pixel grid is the
first halving: turns by 90 degrees about a cell's centre or corner and shifts by whole cells of 2 x 2 pixels are exact.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.encoder.group_convolution import CellNorm, GroupConvolution, regular_type, scalar_type, weigh
from equigrasp.encoder.image import check_image, check_stride, normalise
from equigrasp.errors import InputError

CELL = 2
"""Pixels of the side of a cell, at whatever stride the features are read out."""


class LocalSteerableUNet(nn.Module):
    """A U-Net of regular fields of C_N in which dilations stand for scales: `(B, 4, H, W)`, `(B, D)` -> features.

    All layers but the first and, at stride 1, the last work at half resolution. Level j descends with taps 2^j cells
    apart, the bottom works with the widest, the way up goes back through them; skips are added. Language enters as
    scalars that weigh the fields of the bottom.

    A feature depends on the pixels within `reach` of its cell's centre along each axis, and on no other; the border of
    the heightmap is seen from no further either. Over a table that is bare for that far, turning what lies around a
    cell's centre or corner by 90 degrees turns the features around it, and moving it by whole cells of 2 x 2 pixels
    moves them, to rounding, whatever lies elsewhere.

    Args:
        embedding_size: D.
        channels: C, features for each read-out cell.
        stride: 2 reads out at half resolution, 1 at full.
        widths: regular fields at each level, one number for each.
        group_order: N, a multiple of 4.

    Raises:
        InputError: if the stride is neither 1 nor 2, a width is not positive, or N is not a multiple of 4.
    """

    def __init__(
        self,
        embedding_size: int,
        channels: int = 8,
        stride: int = 2,
        widths: tuple[int, ...] = (8, 16, 16, 16),
        group_order: int = 4,
    ) -> None:
        super().__init__()
        check_stride(stride)
        if not widths or min(widths) < 1:
            raise InputError(f"a local U-Net has one width a level, each at least 1, but these are {widths}")
        self.stride = stride
        self.in_type = scalar_type(group_order, 4)
        self.out_type = fields.trivial_type(channels)
        types = [regular_type(group_order, width) for width in widths]
        bottom = types[-1]
        self.stem = _layer(GroupConvolution(self.in_type, types[0], 6, "halve"))
        self.down = nn.ModuleList(
            _layer(GroupConvolution(a, b, dilation=2**level)) for level, (a, b) in enumerate(itertools.pairwise(types))
        )
        self.language = nn.Linear(embedding_size, widths[-1])
        self.fuse = GroupConvolution(bottom + bottom, bottom, 1)
        self.bottom = _layer(GroupConvolution(bottom, bottom, dilation=2 ** len(self.down)))
        self.project = nn.ModuleList(GroupConvolution(b, a, 1) for a, b in itertools.pairwise(types))
        self.up = nn.ModuleList(
            _layer(GroupConvolution(each, each, dilation=2**level)) for level, each in enumerate(types[:-1])
        )
        features = scalar_type(group_order, channels)
        size, resample = (3, "same") if stride == 2 else (6, "double")
        self.out = GroupConvolution(types[0], features, size, resample)
        self.offset = nn.Parameter(torch.zeros(channels))

    @property
    def reach(self) -> float:
        """How far a feature sees from its cell's centre along each axis, in pixels of the heightmap.

        Pixels are counted by their centres; a cell's centre lies half a pixel from those of its own.
        """
        convolutions = [each for each in self.modules() if isinstance(each, GroupConvolution)]
        return sum(each.reach * (CELL if each.resample == "same" else 1) for each in convolutions)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """Colour 0 .. 255 and height in metres, `(B, 4, H, W)`, and the unit embedding `(B, D)` -> features.

        Raises:
            InputError: if H or W is odd.
        """
        check_image(observation, CELL)
        x = self.stem(normalise(observation).contiguous(memory_format=torch.channels_last))
        skips = []
        for layer in self.down:
            skips.append(x)
            x = layer(x)
        weights = self.language(embedding * math.sqrt(embedding.shape[1]))
        x = self.bottom(x + self.fuse(torch.cat([x, weigh(x, weights)], dim=1)))
        for project, layer, skip in zip(reversed(self.project), reversed(self.up), reversed(skips), strict=True):
            x = layer(project(x) + skip)
        return self.out(x) + self.offset[:, None, None]


def _layer(convolution: GroupConvolution) -> nn.Sequential:
    return nn.Sequential(convolution, CellNorm(convolution.out_type), nn.ReLU(inplace=True))
