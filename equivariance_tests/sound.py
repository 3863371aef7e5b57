"""Sound kernels, policies and lifts as formulas, of which one thing can be changed: what mutants are made of.

Gaussian rings times circular harmonics in float64, so that they can be stretched and shifted exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from equigrasp import fields
from equigrasp.correlation import correlate
from equigrasp.kernel.lift import soft_disc, turn_matrix
from equivariance_tests.subjects import ActionSubject, KernelSubject, LiftSubject, PolicySubject

CHANNELS, EMBEDDING, FREQUENCY = 3, 8, 8
EVEN = tuple(range(0, FREQUENCY + 1, 2))
Change = Callable[[Tensor], Tensor]


def same(tensor: Tensor) -> Tensor:
    """No change."""
    return tensor


def harmonics(points: Tensor, radii: Sequence[float], frequencies: Sequence[int]) -> Tensor:
    """Rings times harmonics at points `(P, 2)`: `(O, len(radii), P)`, cosine and sine for each frequency but 0."""
    x, y = points.T
    radius, angle = torch.hypot(x, y), torch.atan2(y, x)
    rings = torch.exp(-((radius - torch.tensor(radii, dtype=torch.float64)[:, None]) ** 2) / (2 * 0.8**2))
    waves = []
    for m in frequencies:
        # the centre has no angle
        waves += [(radius > 0) * torch.cos(m * angle), torch.sin(m * angle)] if m else [torch.ones_like(angle)]
    return torch.stack([wave * rings for wave in waves])


def kernel(
    name: str = "sound kernel",
    *,
    place: Change = same,
    change: Change = same,
    size: int = 33,
    radii: Sequence[float] = (7.0, 8.5, 10.0),
    frequencies: Sequence[int] = EVEN,
    read_out: Change = same,
    correlation: Callable[[Tensor, Tensor], Tensor] = correlate,
    channels: int = CHANNELS,
) -> KernelSubject:
    """A steerable kernel with one thing changed.

    Args:
        name: for tables.
        place: where the formula is evaluated, from where it should be.
        change: of the finished kernel `(O, C, k, k)`.
        size: k.
        radii: of the rings, pixels.
        frequencies: of the type.
        read_out: change of the Fourier synthesis.
        correlation: instead of the sound one.
        channels: C.
    """
    basis = harmonics(place(fields.grid(size)), radii, frequencies)
    rng = torch.Generator().manual_seed(1)
    weigh = torch.randn(EMBEDDING, channels, len(frequencies), len(radii), dtype=torch.float64, generator=rng)
    # cosine and sine of one frequency share their weight
    index = torch.tensor([i for i, m in enumerate(frequencies) for _ in range(2 if m else 1)])

    def generate(embedding: Tensor) -> Tensor:
        weights = torch.einsum("bd,dcfr->bcfr", embedding, weigh)[:, :, index]
        kernels = torch.einsum("bcor,orp->bocp", weights, basis).unflatten(3, (size, size))
        return torch.stack([change(each) for each in kernels])

    space = fields.gspace()
    irreps: list[fields.Representation] = [space.fibergroup.irrep(m) for m in frequencies]
    kind = fields.FieldType(space, [fields.directsum(irreps, name="harmonics " + " ".join(map(str, frequencies)))])
    bins = read_out(fields.synthesis(FREQUENCY)) if tuple(frequencies) == EVEN else None
    scalars = fields.trivial_type(channels)
    return KernelSubject(name, generate, EMBEDDING, scalars, kind, torch.float64, bins, correlation)


def policy(
    name: str = "sound policy",
    *,
    phi: Change = same,
    change: Change = same,
    bins: Change = same,
    scores: Change = same,
    correlation: Callable[[Tensor, Tensor], Tensor] = correlate,
    dtype: torch.dtype = torch.float64,
) -> PolicySubject:
    """A phi that turns with each object (the mean of each 2 x 2 cell), a sound kernel, 36 bins; one thing changed."""
    kappa = kernel(change=change, channels=4, size=25, radii=(5.0, 6.5, 8.0), frequencies=EVEN)
    matrix = bins(fields.synthesis(FREQUENCY))
    offset = torch.tensor([90.0, 90.0, 90.0, 0.0], dtype=torch.float64).view(4, 1, 1)
    scale = torch.tensor([40.0, 40.0, 40.0, 0.02], dtype=torch.float64).view(4, 1, 1)

    def score(observation: Tensor, embedding: Tensor) -> Tensor:
        features = phi(functional.avg_pool2d((observation.double() - offset) / scale, 2))
        field = correlation(features, kappa.generate(embedding.double()))
        return scores(torch.einsum("io,bohw->bihw", matrix, field)).to(dtype)

    # half a pixel from a cell's centre to those of its pixels, and 12 cells of the kernel
    return PolicySubject(name, score, EMBEDDING, dtype, 2, reach=24.5)


def lift(name: str = "sound lift", *, order: int = 72, disc: bool = True, sign: int = 1) -> LiftSubject:
    """The paper's lift by bicubic interpolation under a soft disc, one thing changed."""
    size = 25
    window = soft_disc(size) if disc else torch.ones(size**2, dtype=torch.float64)
    turns = torch.stack([turn_matrix(size, sign * 2 * math.pi * j / order) for j in range(order)])
    return LiftSubject(name, lambda psi: torch.einsum("cp,nqp->ncq", psi * window, turns), order, size)


def sound() -> list[Any]:
    """The subjects that the mutants are made of, one of each kind: every law must hold for them."""
    return [kernel(), policy(), lift(), ActionSubject("sound action")]
