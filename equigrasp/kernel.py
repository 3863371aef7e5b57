"""kappa(l): from the embedding of an instruction to a kernel that turns scalars into scores over angles.

Every kernel K(l) here is a field on the pixel grid whose type is declared by `in_type` (scalars) and `out_type`
(even irreps). A steerable one obeys, up to its own measured error, the steerability constraint of LEG (Eq. 7, the
lemma behind Eq. 2), written for world y up:

    K(g x) = rho_out(g) K(x)        for every rotation g about the kernel's centre.

Correlating phi(o) with it then gives a field that turns with the scene, f(T_g o) = T_g rho_out(g) f(o).
Its frequencies being even, a half turn does not change it, K(-x) = K(x); it says so by `even`, and is correlated by a
shorter route (`equigrasp.correlation`). Embeddings are `(B, D)` of unit length; kernels are
`(B, out_type.size, C, k, k)`, rows first, row 0 at the top.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.constant import Constant
from equigrasp.errors import InputError, unknown
from equigrasp.kernel_image import KernelImage
from equigrasp.lift import HalfTurnLift, QuarterTurnLift, frequency_weights, lift_matrix, soft_disc
from equigrasp.rings import RINGS, outermost_ring


class SteerableKernel(nn.Module):
    """The exact construction: the instruction weighs the elements of a steerable basis (`equigrasp.rings`).

    A basis that solves the constraint in the plane is exact on a grid only as far as the grid can carry it, so
    rings end `margin` pixels inside the kernel's edge, and none carries a frequency that it is too small for. Then
    the constraint holds to 1e-12 at quarter turns (float64), and at any angle to 1e-6 for inputs below a quarter of
    the Nyquist limit and 3e-5 below half of it ("gaussian" rings: 5e-5 and 1e-3; the worst of 200 kernels).

    Args:
        embedding_size: D.
        channels: C, of phi's features.
        size: k, in read-out pixels; odd.
        maximum_frequency: even; None for the highest that the rings carry (22 for 33 pixels, "gaussian" 16).
        hidden: width of the two hidden layers between the embedding and the coefficients.
        margin: pixels from the outermost ring to the kernel's edge.
        rings: a name from `equigrasp.rings.RINGS`.

    Raises:
        InputError: if the size is even, too small for a ring, or too small for the frequency.
    """

    even = True

    def __init__(
        self,
        embedding_size: int,
        channels: int = 8,
        size: int = 33,
        maximum_frequency: int | None = None,
        hidden: int = 256,
        margin: float = 4.0,
        rings: str = "smooth",
    ) -> None:
        super().__init__()
        check_size(size)
        if rings not in RINGS:
            raise unknown("family of rings", rings, RINGS)
        family, outermost = RINGS[rings], outermost_ring(size, margin)
        if outermost < 2:
            raise InputError(
                f"a kernel of {size} pixels has no room for a ring {margin} pixels inside its edge; "
                f"use an odd size of {2 * math.ceil(1.5 + margin) + 1} or more"
            )
        carried = int(family.carried(outermost)) // 2 * 2
        if maximum_frequency is None:
            maximum_frequency = min(carried, fields.HIGHEST_FREQUENCY)
        if maximum_frequency > carried:
            raise InputError(
                f"a kernel of {size} pixels carries frequencies up to {carried}, not {maximum_frequency}; "
                "use a larger size or a lower frequency"
            )
        self.size = size
        self.channels = channels
        self.in_type = fields.trivial_type(channels)
        self.out_type = fields.even_type(maximum_frequency)

        bases = [family.basis(size, outermost, m) for m in range(0, maximum_frequency + 1, 2)]
        self.elements = [len(basis) for basis in bases]
        scale = 1 / math.sqrt(channels * sum(self.elements))
        self.bases = nn.ModuleList(Constant(scale * basis) for basis in bases)
        self.embedding_size = embedding_size
        self.coefficients = nn.Sequential(
            nn.Linear(embedding_size, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, channels * sum(self.elements)),
        )

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, D)` -> `(B, out_type.size, C, k, k)`."""
        check_embedding(embedding, self.embedding_size)
        weights = self.coefficients(embedding * math.sqrt(embedding.shape[1]))
        return self.expand(weights.unflatten(1, (self.channels, -1)))

    def expand(self, weights: Tensor) -> Tensor:
        """Coefficients `(B, C, sum(elements))` -> the kernel that they weigh, `(B, out_type.size, C, k, k)`."""
        each = zip(weights.split(self.elements, dim=2), self.bases, strict=True)
        parts = [torch.einsum("bcn,ndp->bdcp", weight, basis.value) for weight, basis in each]
        return torch.cat(parts, dim=1).unflatten(3, (self.size, self.size))


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
        size: k, in read-out pixels; odd.
        maximum_frequency: even.
        group_order: n; a multiple of 4, because C_n must contain the quarter turns that a grid has.
        exact_quarter_turns: False allows another n, as the paper's own 90, which errs by up to 9e-3 at 90 degrees.
        widths: channels of psi's three scales.

    Raises:
        InputError: if the size is even, or n is too small or not a multiple of 4.
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
        """`(B, D)` -> `(B, out_type.size, C, k, k)`."""
        check_embedding(embedding, self.embedding_size)
        return self.lift(self.psi(embedding))


class PlainKernel(nn.Module):
    """A kernel with no symmetry: psi's U-Net puts out every channel of every coefficient itself (LEG, Table 4).

    It is LiftedKernel without the lift, and nothing else: the same network on the same instruction under the same
    soft disc. It declares the types that its use as a kernel implies, so that it can be read out to 36 bins and a
    law can be put to it; each law about turns then fails, a quarter turn not excepted.

    Args:
        embedding_size: D.
        channels: C, of phi's features.
        size: k, in read-out pixels; odd.
        maximum_frequency: even.
        widths: channels of the U-Net's three scales.

    Raises:
        InputError: if the size is even, or the frequency odd.
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


def check_size(size: int) -> None:
    """Raise an InputError unless the kernel has a centre pixel: an even size is off centre by half a pixel."""
    if size % 2 == 0 or size < 1:
        raise InputError(
            f"a kernel turns about its centre pixel, so its size is odd, but this is {size}; "
            f"use {size - 1 if size > 1 else 1} or {size + 1}"
        )


def check_embedding(embedding: Tensor, width: int) -> None:
    """Raise an InputError unless these are embeddings `(B, width)` of a floating dtype."""
    if embedding.ndim != 2 or embedding.shape[1] != width:
        raise InputError(
            f"this module was made for embeddings (B, {width}), but this is {tuple(embedding.shape)}; "
            "give it the width of your text encoder"
        )
    if not embedding.is_floating_point():
        raise InputError(f"embeddings are of a floating dtype, but this is {embedding.dtype}; use embedding.float()")
