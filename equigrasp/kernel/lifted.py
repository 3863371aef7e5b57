"""The paper's construction of kappa(l): an image, lifted over C_n and Fourier-transformed (LEG-UNet's kernel)."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.errors import InputError
from equigrasp.kernel.image import KernelImage
from equigrasp.kernel.inputs import check_embedding, check_size
from equigrasp.kernel.lift import HalfTurnLift, QuarterTurnLift, frequency_weights, lift_matrix


class LiftedKernel(nn.Module):
    """The paper's construction: an image psi(l), turned by every element of C_n, Fourier-transformed over C_n.

    psi(l), `(B, C, k, k)`, comes from a small U-Net on the tiled embedding and fades out in a soft disc. Its lift
    is the regular field L(x, theta_j) = psi(R(-theta_j) x), theta_j = 2 pi j / n, by bicubic interpolation. The
    even frequencies of L over j, weighed by `frequency_weights`, are the kernel. Disc, turns, transform and weights are
    linear in psi and do not depend on the instruction, so they are one matrix, made once in float64 (LEG, the lift and
    the Fourier transform of kappa).

    The constraint holds exactly at quarter turns, and elsewhere as well as psi can be interpolated: with fresh weights
    to 5e-3 for inputs below a quarter of the Nyquist limit, and 3e-2 below half of it. That the turn is one of C_n does
    not help: the grid has four turns.

    Args:
        embedding_size: D.
        channels: C, of phi's features.
        size: k, in read-out pixels; odd, at least 5.
        maximum_frequency: even.
        group_order: n; a multiple of 4, because C_n must contain the quarter turns that a grid has.
        exact_quarter_turns: False allows another n, as the paper's own 90, which errs by up to 9e-3 at 90 degrees.
        widths: channels of psi's three scales.

    Raises:
        InputError: if the size is even or less than 5, or n is too small or not a multiple of 4.
    """

    even = True

    def __init__(
        self,
        embedding_size: int,
        channels: int = 8,
        size: int = 25,
        maximum_frequency: int = 16,
        group_order: int = 72,
        exact_quarter_turns: bool = True,
        widths: tuple[int, int, int] = (32, 64, 192),
    ) -> None:
        super().__init__()
        check_size(size)
        if exact_quarter_turns and group_order % 4:
            raise InputError(
                f"C_{group_order} does not contain a turn by 90 degrees; use a multiple of 4 such as 72, "
                "or exact_quarter_turns=False to measure what that costs"
            )
        if group_order % 2 or group_order <= 2 * maximum_frequency:
            raise InputError(
                f"C_{group_order} does not carry frequency {maximum_frequency}; "
                f"use an even order above {2 * maximum_frequency}"
            )
        self.size = size
        self.channels = channels
        self.in_type = fields.trivial_type(channels)
        self.out_type = fields.even_type(maximum_frequency)
        self.embedding_size = embedding_size
        self.psi = KernelImage(embedding_size, channels, size, widths)
        lift = lift_matrix(size, maximum_frequency, group_order)
        lift *= frequency_weights(maximum_frequency)[:, None, None]
        turns = HalfTurnLift if group_order % 4 else QuarterTurnLift
        # a white psi of unit variance gives a kernel of about unit length
        self.lift = turns(lift / (2 * math.sqrt(channels) * lift.norm()), size)

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, D)` -> `(B, out_type.size, C, k, k)`; psi is lifted in the embedding's dtype, under autocast too."""
        check_embedding(embedding, self.embedding_size)
        psi = self.psi(embedding)
        # a lift turns any psi, a rounded one as well, but what is rounded after it is no lift
        with torch.autocast(psi.device.type, enabled=False):
            return self.lift(psi.to(embedding))
