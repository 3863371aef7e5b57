"""The exact construction of kappa(l): an instruction weighs the elements of a steerable basis."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.constant import Constant
from equigrasp.errors import InputError, unknown
from equigrasp.kernel.inputs import check_embedding, check_size
from equigrasp.kernel.rings import RINGS, outermost_ring


class SteerableKernel(nn.Module):
    """The exact construction: the instruction weighs the elements of a steerable basis (`equigrasp.kernel.rings`).

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
        rings: a name from `equigrasp.kernel.rings.RINGS`.

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
        """Coefficients `(B, C, sum(elements))` -> the kernel that they weigh, `(B, out_type.size, C, k, k)`.

        In the basis's dtype, under autocast too: any coefficients weigh a steerable kernel, rounded ones as well, but
        its taps, once rounded, are those of none.
        """
        with torch.autocast(weights.device.type, enabled=False):
            each = zip(weights.split(self.elements, dim=2), [basis.value for basis in self.bases], strict=True)
            parts = [torch.einsum("bcn,ndp->bdcp", weight.to(basis), basis) for weight, basis in each]
            return torch.cat(parts, dim=1).unflatten(3, (self.size, self.size))
