"""Two streams: what is meant, read from CLIP's frozen image tower and the instruction; and where, from RGB-D.

After CLIPort's pick module (Shridhar et al. 2021): the text multiplies the semantic stream's features at three
stages of its decoder, and at every stage after them the spatial stream's features of the same resolution join. There
is no full-resolution layer, as in `equigrasp.encoder.unet`: the streams end at half of it.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.encoder.clip_image import ClipImage
from equigrasp.encoder.image import check_image, check_widths, normalise
from equigrasp.encoder.unet import convolution
from equigrasp.errors import InputError

STRIDE = 2
"""Heightmap pixels a cell of the output."""


class TwoStream(nn.Module):
    """`(B, 4, H, W)`, `(B, D)` -> `(B, outputs, H / 2, W / 2)`.

    Args:
        embedding_size: D.
        image: the frozen tower.
        semantic_widths: channels of the semantic stream at 1/32, 1/16, 1/8 and 1/4 of the resolution.
        spatial_widths: channels of the spatial stream at 1/2, 1/4, 1/8, 1/16 and 1/32.
        outputs: channels of the result.
        join: how the streams join at a stage: `Concatenation` (CLIPort's) or `Product`.

    Raises:
        InputError: if the widths are not four and five multiples of 8.
    """

    stride = STRIDE

    def __init__(
        self,
        embedding_size: int,
        image: ClipImage,
        semantic_widths: tuple[int, ...],
        spatial_widths: tuple[int, ...],
        outputs: int,
        join: type[Concatenation] | type[Product],
    ) -> None:
        super().__init__()
        check_widths(STRIDE, spatial_widths)
        if len(semantic_widths) != 4 or any(width % 8 or width < 8 for width in semantic_widths):
            raise InputError(f"a semantic stream has four widths, multiples of 8, but these are {semantic_widths}")
        self.out_type = fields.trivial_type(outputs)
        self.image = image
        self.spatial = SpatialStream(spatial_widths)
        deepest, *skips = image.channels
        # the last stage has no map of CLIP's beside it, and no text
        semantic = (*semantic_widths, spatial_widths[0])
        self.into = convolution(deepest, semantic[0])
        self.text = nn.ModuleList(nn.Linear(embedding_size, width) for width in semantic_widths[:3])
        self.up = nn.ModuleList(
            nn.Sequential(convolution(before + skip, before), convolution(before, after))
            for before, after, skip in zip(semantic_widths, semantic[1:], (*skips, 0), strict=True)
        )
        self.join = nn.ModuleList(join(a, b) for a, b in zip(semantic[1:], spatial_widths[3::-1], strict=True))
        self.out = nn.Conv2d(semantic[-1], outputs, 3, padding=1)
        # the frozen tower has its own layout
        for part in (self.spatial, self.into, self.up, self.join, self.out):
            part.to(memory_format=torch.channels_last)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """Colour 0 .. 255 and height in metres, `(B, 4, H, W)`, and the unit embedding `(B, D)` -> outputs."""
        check_image(observation)
        deepest, *skips = self.image(observation)
        stages = self.spatial(observation)
        embedding = embedding * math.sqrt(embedding.shape[1])
        x = self.into(resized(deepest, [side // 32 for side in observation.shape[2:]]))
        for index, (layer, join, spatial) in enumerate(zip(self.up, self.join, stages, strict=True)):
            if index < len(self.text):
                x = x * self.text[index](embedding)[:, :, None, None]
            x = resized(x, spatial.shape[2:])
            if index < len(skips):
                x = torch.cat([x, resized(skips[index], spatial.shape[2:])], dim=1)
            x = join(layer(x), spatial)
        return self.out(x)


class SpatialStream(nn.Module):
    """A residual U-Net on RGB-D, not told the instruction: `(B, 4, H, W)` -> its decoder's maps at 1/16 to 1/2.

    Args:
        widths: channels at 1/2, 1/4, 1/8, 1/16 and 1/32 of the resolution.
    """

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.stem = nn.Sequential(convolution(16, widths[0]), Residual(widths[0]))
        self.down = nn.ModuleList(nn.Sequential(convolution(a, b), Residual(b)) for a, b in itertools.pairwise(widths))
        ascending = widths[::-1]
        self.project = nn.ModuleList(nn.Conv2d(a, b, 1, bias=False) for a, b in itertools.pairwise(ascending))
        self.up = nn.ModuleList(convolution(width, width) for width in ascending[1:])

    def forward(self, observation: Tensor) -> list[Tensor]:
        """Maps `(B, widths[i], h, w)` at 1/16, 1/8, 1/4 and 1/2 of the resolution."""
        x = functional.pixel_unshuffle(normalise(observation), 2).contiguous(memory_format=torch.channels_last)
        x = self.stem(x)
        skips, stages = [], []
        for layer in self.down:
            skips.append(x)
            x = layer(functional.max_pool2d(x, 2))
        for project, layer, skip in zip(self.project, self.up, reversed(skips), strict=True):
            x = layer(resized(project(x), skip.shape[2:]) + skip)
            stages.append(x)
        return stages


class Residual(nn.Module):
    """x + two convolutions of it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(convolution(width, width), convolution(width, width))

    def forward(self, x: Tensor) -> Tensor:
        """Shape stays."""
        return x + self.layers(x)


class Concatenation(nn.Module):
    """Both maps side by side, then a 1x1 convolution to the semantic stream's channels (CLIPort's lateral fusion)."""

    def __init__(self, semantic: int, spatial: int) -> None:
        super().__init__()
        self.mix = nn.Conv2d(semantic + spatial, semantic, 1)

    def forward(self, semantic: Tensor, spatial: Tensor) -> Tensor:
        """`(B, a, h, w)`, `(B, b, h, w)` -> `(B, a, h, w)`."""
        return self.mix(torch.cat([semantic, spatial], dim=1))


class Product(nn.Module):
    """The semantic map times a 1x1 convolution of the spatial one: what is meant, where there is something (LEG)."""

    def __init__(self, semantic: int, spatial: int) -> None:
        super().__init__()
        self.weigh = nn.Conv2d(spatial, semantic, 1)

    def forward(self, semantic: Tensor, spatial: Tensor) -> Tensor:
        """`(B, a, h, w)`, `(B, b, h, w)` -> `(B, a, h, w)`."""
        return semantic * self.weigh(spatial)


def resized(x: Tensor, size: tuple[int, ...] | list[int]) -> Tensor:
    """The map at another size, bilinear; itself where the size is its own."""
    if tuple(x.shape[2:]) == tuple(size):
        return x
    return functional.interpolate(x, size=tuple(size), mode="bilinear", align_corners=False)
