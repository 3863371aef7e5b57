"""kappa(l) without steerability, as an ablation has it."""

from __future__ import annotations

import math

from torch import Tensor, nn

from equigrasp import fields
from equigrasp.constant import Constant
from equigrasp.kernel.image import KernelImage
from equigrasp.kernel.inputs import check_embedding, check_size
from equigrasp.kernel.lift import soft_disc


class PlainKernel(nn.Module):
    """A kernel with no symmetry: psi's U-Net puts out every channel of every coefficient itself (LEG, Table 4).

    It is LiftedKernel without the lift, and nothing else: the same network on the same instruction under the same
    soft disc. It declares the types that its use as a kernel implies, so that it can be read out to 36 bins and a
    law can be put to it; each law about turns then fails, a quarter turn not excepted.

    Args:
        embedding_size: D.
        channels: C, of phi's features.
        size: k, in read-out pixels; odd, at least 5.
        maximum_frequency: even.
        widths: channels of the U-Net's three scales.

    Raises:
        InputError: if the size is even or less than 5, or the frequency odd.
    """

    def __init__(
        self,
        embedding_size: int,
        channels: int = 8,
        size: int = 25,
        maximum_frequency: int = 16,
        widths: tuple[int, int, int] = (32, 64, 192),
    ) -> None:
        super().__init__()
        check_size(size)
        self.size = size
        self.channels = channels
        self.in_type = fields.trivial_type(channels)
        self.out_type = fields.even_type(maximum_frequency)
        self.embedding_size = embedding_size
        self.image = KernelImage(embedding_size, self.out_type.size * channels, size, widths)
        disc = soft_disc(size).view(size, size)
        # white images of unit variance give a kernel of unit length
        self.disc = Constant(disc / (math.sqrt(self.out_type.size * channels) * disc.norm()))

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, D)` -> `(B, out_type.size, C, k, k)`."""
        check_embedding(embedding, self.embedding_size)
        return (self.image(embedding) * self.disc.value).unflatten(1, (-1, self.channels))
