"""psi(l): an image that is generated from the instruction, and out of which kernels are made (LEG, psi)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields


class KernelImage(nn.Module):
    """psi before the disc: a U-Net of three scales on the tiled embedding, `(B, D)` -> `(B, C, k, k)`.

    The embedding is tiled together with the two coordinates of each pixel: a convolution sees nothing but its
    border in a constant image.
    """

    def __init__(self, embedding_size: int, channels: int, size: int, widths: tuple[int, int, int]) -> None:
        super().__init__()
        first, second, third = widths
        self.register_buffer(
            "coordinates",
            (2 * fields.grid(size) / size).T.reshape(1, 2, size, size).float(),
            persistent=False,
        )
        self.project = nn.Linear(embedding_size, third)
        self.tile = nn.Linear(third, first)
        self.place = nn.Conv2d(2, first, 3, padding=1)
        self.down = _block(first, second)
        self.bottom = nn.Sequential(_block(second + third, third), _block(third, third))
        self.up_second = _block(third + second, second)
        self.up_first = _block(second + first, first)
        self.out = nn.Conv2d(first, channels, 3, padding=1)

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, D)` -> `(B, C, k, k)`."""
        language = functional.relu(self.project(embedding * math.sqrt(embedding.shape[1])))
        x = self.place(self.get_buffer("coordinates")) + self.tile(language)[:, :, None, None]
        first = functional.relu(x)
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
        return self.out(x)


def convolve_tiled(vector: Tensor, weight: Tensor, shape: Sequence[int]) -> Tensor:
    """The 3x3 convolution of a vector that is the same at each pixel, zero outside.

    `(B, I)` and `(O, I, 3, 3)` -> `(B, O, *shape)`: each tap is weighed once, and not at each pixel again.
    """
    taps = torch.einsum("bi,oit->bot", vector, weight.flatten(2))
    inside = functional.unfold(vector.new_ones(1, 1, *shape), 3, padding=1)[0]
    return (taps @ inside.to(taps.dtype)).unflatten(2, tuple(shape))


def _block(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1, bias=False), nn.GroupNorm(8, outputs), nn.ReLU(inplace=True)
    )


def _resize(x: Tensor, like: Tensor) -> Tensor:
    return functional.interpolate(x, size=like.shape[2:], mode="bilinear", align_corners=False)
