"""psi(l): an image that is generated from the instruction, and out of which kernels are made (LEG, psi)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields

WAVES = (0.125, 0.25, 0.375)
"""Lengths of the plane waves' vectors, of the Nyquist limit: what bicubic interpolation still turns well."""


class KernelImage(nn.Module):
    """psi before the disc: a U-Net of three scales on the tiled embedding, `(B, D)` -> `(B, C, k, k)`.

    A convolution sees nothing but its border in a constant image. So each pixel's place is given beside the tiled
    embedding: its coordinates, and plane waves in four directions (`WAVES`), without which psi is too smooth to have
    the high frequencies over angles that tell one angle from the next. The embedding scales the features at the finest
    resolution, before and after the U-Net: an image is then a sum of patterns, each weighed by the instruction, as a
    steerable kernel is a sum of basis elements.
    """

    def __init__(self, embedding_size: int, channels: int, size: int, widths: tuple[int, int, int]) -> None:
        super().__init__()
        first, second, third = widths
        places = _places(size)
        self.register_buffer("places", places, persistent=False)
        self.project = nn.Linear(embedding_size, third)
        self.tile = nn.Linear(third, first)
        self.place = nn.Conv2d(places.shape[1], first, 3, padding=1)
        self.down = _block(first, second)
        self.bottom = nn.Sequential(_block(second + third, third), _block(third, third))
        self.up_second = _block(third + second, second)
        self.up_first = _block(second + first, first)
        self.gate = nn.Linear(third, first)
        self.out = nn.Conv2d(first, channels, 3, padding=1)

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, D)` -> `(B, C, k, k)`."""
        language = functional.relu(self.project(embedding * math.sqrt(embedding.shape[1])))
        first = functional.relu(_scaled(self.place(self.get_buffer("places")), self.tile(language)))
        second = self.down(functional.max_pool2d(first, 2, ceil_mode=True))
        third = functional.max_pool2d(second, 2, ceil_mode=True)
        first_block, second_block = self.bottom
        convolution, norm, activation = first_block  # ty: ignore[not-iterable]
        # the convolution of both side by side, of which the tiled half is the same at each pixel but for the border
        seen, said = convolution.weight.split([third.shape[1], language.shape[1]], dim=1)
        both = functional.conv2d(third, seen, padding=1) + convolve_tiled(language, said, third.shape[2:])
        third = second_block(activation(norm(both)))
        x = self.up_second(torch.cat([_resize(third, second), second], dim=1))
        x = self.up_first(torch.cat([_resize(x, first), first], dim=1))
        return self.out(_scaled(x, self.gate(language)))


def convolve_tiled(vector: Tensor, weight: Tensor, shape: Sequence[int]) -> Tensor:
    """The 3x3 convolution of a vector that is the same at each pixel, zero outside.

    `(B, I)` and `(O, I, 3, 3)` -> `(B, O, *shape)`: each tap is weighed once, and not at each pixel again.
    """
    taps = torch.einsum("bi,oit->bot", vector, weight.flatten(2))
    inside = functional.unfold(vector.new_ones(1, 1, *shape), 3, padding=1)[0]
    return (taps @ inside.to(taps.dtype)).unflatten(2, tuple(shape))


def _places(size: int) -> Tensor:
    """What sets pixels apart: two coordinates from -1 to 1, and plane waves, `(1, 2 + 8 * len(WAVES), k, k)`."""
    points = fields.grid(size)
    angles = torch.arange(4, dtype=points.dtype) * (math.pi / 4)
    directions = torch.stack([torch.cos(angles), torch.sin(angles)])
    phases = torch.cat([math.pi * length * (points @ directions) for length in WAVES], dim=1)
    places = torch.cat([2 * points / size, torch.cos(phases), torch.sin(phases)], dim=1)
    return places.T.reshape(1, -1, size, size).to(torch.get_default_dtype())


def _scaled(x: Tensor, by: Tensor) -> Tensor:
    """`(B or 1, C, k, k)` and `(B, C)` -> `(B, C, k, k)`: every channel times one and what it is scaled by."""
    return x * (1 + by)[:, :, None, None]


def _block(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1, bias=False), nn.GroupNorm(8, outputs), nn.ReLU(inplace=True)
    )


def _resize(x: Tensor, like: Tensor) -> Tensor:
    return functional.interpolate(x, size=like.shape[2:], mode="bilinear", align_corners=False)
