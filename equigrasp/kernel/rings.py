"""The steerable basis trivial -> irrep(m) on the pixels of a kernel: circular harmonics on rings.

In polar coordinates the constraint K(g x) = rho(g) K(x) leaves the radial profile free and fixes the angle
(LEG, Eq. 7; Weiler and Cesa 2019, table of trivial -> irrep kernels). What a grid makes of it depends on the profile
alone: the correlation with a wave k sees, beside the kernel's Fourier transform at k, that at k + 2 pi n.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import torch
from escnn.kernels import kernels_SO2_act_R2
from scipy.special import ive
from torch import Tensor

from equigrasp import fields
from equigrasp.default_dtype import in_float32


@dataclass(frozen=True)
class Rings:
    """A family of radial profiles, one around each whole radius, and how far it carries frequencies.

    Attributes:
        innermost: radius of the first ring, pixels.
        sigma: width of a ring, pixels.
        cutoff: a ring of radius q carries frequencies m <= cutoff (q - sigma), and 0.
        smooth: whether rings are blurred circles. A circle times exp(i m phi), blurred in the plane by a Gaussian,
            has the profile exp(-(r - q)^2 / 2 sigma^2) ive(m, r q / sigma^2) and the Fourier transform
            exp(-sigma^2 k^2 / 2) J_m(q k): nothing is left to alias. Without, the profile is the first factor
            alone, which for m > 0 has a kink at the kernel's centre.
    """

    innermost: int
    sigma: float
    cutoff: float
    smooth: bool

    def radii(self, outermost: int) -> list[float]:
        """The radii of all rings, pixels."""
        return [float(radius) for radius in range(self.innermost, outermost + 1)]

    def carried(self, radius: float) -> float:
        """The highest frequency that the ring of that radius carries."""
        return max(0.0, self.cutoff * (radius - self.sigma))

    def basis(self, size: int, outermost: int, m: int) -> Tensor:
        """Elements of frequency m, each of unit length, `(n, 1 or 2, size * size)` float64.

        Two for each ring (a complex coefficient), one where m = 0; their order and signs are escnn's.
        """
        radii = [radius for radius in self.radii(outermost) if m <= self.carried(radius)]
        space = fields.gspace()
        irrep = space.fibergroup.irrep(m)
        # escnn mixes dtypes where torch's default is another
        with in_float32():
            shared = kernels_SO2_act_R2(space.trivial_repr, irrep, radii, self.sigma, maximum_frequency=m)
        points = fields.grid(size)
        # escnn caches bases for the whole process: a copy, or .double() would change everyone's
        basis = copy.deepcopy(shared).double().sample(points)[..., 0].permute(1, 2, 0)
        if self.smooth:
            radius = torch.tensor([element["radius"] for element in shared], dtype=torch.float64)
            argument = radius[:, None, None] * points.norm(dim=1) / self.sigma**2
            basis = basis * torch.from_numpy(ive(m, argument.numpy()))
        return basis / basis.flatten(1).norm(dim=1)[:, None, None]


def outermost_ring(size: int, margin: float) -> int:
    """Radius of the last ring that lies `margin` pixels inside the edge of a kernel of that size."""
    return math.floor(size / 2 - margin)


RINGS: dict[str, Rings] = {
    "smooth": Rings(innermost=0, sigma=1.0, cutoff=2.0, smooth=True),
    "gaussian": Rings(innermost=2, sigma=0.8, cutoff=1.5, smooth=False),
}
"""escnn's Gaussian rings, and the smooth ones, which err a fortieth as much and carry a third more elements."""
