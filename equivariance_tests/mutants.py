"""Broken kernels, policies, lifts and actions: the test of the laws. A law that no mutant breaks is no law.

Each mutant is a sound subject (`sound.py`) with one thing wrong, and names the law that is meant to notice.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from equigrasp import fields
from equigrasp.correlation import Correlation, correlate
from equigrasp.grasp import Grasp, Observation
from equigrasp.workspace import WORKSPACE, Motion, Workspace
from equivariance_tests.scenes import lattice
from equivariance_tests.sound import Change, kernel, lift, policy
from equivariance_tests.subjects import ActionSubject, KernelSubject, PolicySubject


class Clockwise(Workspace):
    """The closing axis turns the other way than the scene."""

    def move_grasp(self, motion: Motion, grasp: Grasp) -> Grasp:
        """Broken."""
        moved = super().move_grasp(motion, grasp)
        return replace(moved, theta=grasp.theta - motion.angle)


class Taller(Workspace):
    """A turned scene is taller: as if height were a coordinate of the plane."""

    def move_observation(
        self, motion: Motion, observation: Observation, table: NDArray[np.uint8] | None = None, level: float = 0.0
    ) -> Observation:
        """Broken."""
        moved = super().move_observation(motion, observation, table, level)
        return Observation(moved.color, moved.height * (1 + 0.05 * abs(math.sin(motion.angle / 2))))


class RightToLeft(Motion):
    """Composition in the wrong order."""

    def __matmul__(self, other: Motion) -> Motion:
        """Broken."""
        return Motion(other.angle, other.x, other.y) @ Motion(self.angle, self.x, self.y)


def scaled(x: float, y: float) -> Change:
    """Points stretched along the axes."""
    return lambda points: points * points.new_tensor([x, y])


def noise(share: float) -> Change:
    """White noise of that share of the kernel's own deviation."""

    def add(taps: Tensor) -> Tensor:
        drawn = torch.randn(taps.shape, dtype=taps.dtype, generator=torch.Generator().manual_seed(2))
        return taps + share * taps.std() * drawn

    return add


def clockwise(taps: Tensor) -> Tensor:
    """Sines negated: rho(-g) where rho(g) should be."""
    return taps * torch.tensor([1.0, *[1.0, -1.0] * (len(taps) // 2)], dtype=taps.dtype)[:, None, None, None]


def sign_of(frequency: int) -> Change:
    """One frequency turns the other way."""

    def negate(taps: Tensor) -> Tensor:
        signs = torch.ones(len(taps), dtype=taps.dtype)
        signs[frequency] = -1  # the sine of frequency m is row m of a0, a2, b2, a4, b4, ..
        return taps * signs[:, None, None, None]

    return negate


def uneven(taps: Tensor) -> Tensor:
    """Taps in four directions stronger than those between."""
    x, y = fields.grid(taps.shape[-1]).T
    return taps * (1 + 0.5 * torch.cos(4 * torch.atan2(y, x))).view(taps.shape[2:])


def square(taps: Tensor) -> Tensor:
    """Cut to a square of 13 pixels, where a disc would turn."""
    return taps * (fields.grid(taps.shape[-1]).abs().max(dim=1).values <= 6).view(taps.shape[2:])


def shuffled(count: int) -> Tensor:
    """A fixed random order."""
    return torch.randperm(count, generator=torch.Generator().manual_seed(3))


def of_even_size(features: Tensor, taps: Tensor) -> Tensor:
    """The correlation with an even number of taps, which lie to the left of and above their centre by half a pixel."""
    return correlate(features, functional.pad(taps, (0, 1, 0, 1)))


def wrapped(features: Tensor, taps: Tensor) -> Tensor:
    """A correlation on a torus, as an FFT without padding has it."""
    radius = taps.shape[-1] // 2
    around = functional.pad(features, (radius,) * 4, mode="circular")
    return correlate(around, taps)[..., radius:-radius, radius:-radius]


def at_even_sizes(broken: Correlation) -> Correlation:
    """Sound where rows are odd, as the laws' scenes once were; policies have 80."""
    return lambda features, taps: correlate(features, taps) if features.shape[2] % 2 else broken(features, taps)


def off_by_one(features: Tensor, taps: Tensor) -> Tensor:
    """A correlation whose halves were put back in the wrong order: fftshift for ifftshift."""
    return correlate(features, taps).roll((1, 1), (2, 3))


def by_the_first(features: Tensor, taps: Tensor) -> Tensor:
    """Every scene of a batch by the first instruction's kernel."""
    return functional.conv2d(features, taps[0], padding="same")


def vignette(field: Tensor) -> Tensor:
    """Fainter away from the middle, as a network that sees coordinates or borders."""
    rows, columns = field.shape[2:]
    distance = lattice(rows, columns).norm(dim=1).view(rows, columns) / rows
    return field / (1 + distance**2)


def forbidden(scores: Tensor) -> Tensor:
    """Scores at the table's edge that no argmax takes; beside them all others look alike."""
    return functional.pad(scores[..., 2:-2, 2:-2], (2,) * 4, value=-1e9)


def torn(features: Tensor) -> Tensor:
    """The right-hand half of the table two cells further up."""
    left, right = features.tensor_split(2, dim=3)
    return torch.cat([left, right.roll(-2, 2)], dim=3)


def off_where_acting(features: Tensor) -> Tensor:
    """One cell off where the table has an odd number of a U-Net's coarsest cells, as that of 160 pixels has."""
    return features.roll(1, 2) if features.shape[2] // 16 % 2 else features


def torn_where_acting(features: Tensor) -> Tensor:
    """`torn` there alone."""
    return torn(features) if features.shape[2] // 16 % 2 else features


def glancing(features: Tensor) -> Tensor:
    """Each cell together with the mean of the cells up to 20 away: it turns with the scene, and sees further."""
    return features + functional.avg_pool2d(features, 41, stride=1, padding=20)


def edges(features: Tensor) -> Tensor:
    """Steps from cell to cell that are steeper than a smooth object's, looked for along rows alone."""
    return features + 3 * functional.relu((features - features.roll(1, 3)).abs() - 1)


def darker(features: Tensor) -> Tensor:
    """What is darker than the table is blurred along rows alone."""
    dark = functional.relu(-features[:, :3] - 0.1)
    return torch.cat([features[:, :3] - functional.avg_pool2d(dark, (1, 7), 1, (0, 3)), features[:, 3:]], dim=1)


def beside_the_first_column(features: Tensor) -> Tensor:
    """Colours relative to the table's, which is taken row by row from the first column."""
    return torch.cat([features[:, :3] - features[:, :3, :, :1], features[:, 3:]], dim=1)


def normalised(features: Tensor) -> Tensor:
    """Fainter, the more there is on the whole table."""
    return features / (1 + features.std(dim=(1, 2, 3), keepdim=True))


def normalised_by_batch(features: Tensor) -> Tensor:
    """Fainter, the more there is on the tables of a batch together."""
    return features / (1 + features.std())


@dataclass(frozen=True)
class Mutant:
    """One thing broken.

    Attributes:
        name: what is wrong.
        law: the one that is meant to notice.
        make: the broken subject.
    """

    name: str
    law: str
    make: Callable[[], Any]


def _odd(correlation: Correlation) -> KernelSubject:
    return kernel(frequencies=tuple(range(6)), correlation=correlation)


MUTANTS: tuple[Mutant, ...] = (
    Mutant("wrong sign", "eq. 2, whole bins", lambda: kernel(change=clockwise)),
    Mutant("mirrored", "steerability", lambda: kernel(change=lambda taps: taps.flip(3))),
    Mutant("off centre by half a pixel", "lemma 1", lambda: kernel(place=lambda points: points + 0.5)),
    Mutant("stretched by 5%", "steerability", lambda: kernel(place=scaled(1.05, 1.0))),
    Mutant("shuffled channels", "equivariance", lambda: kernel(change=lambda taps: taps[shuffled(len(taps))])),
    Mutant("one sine 5% too strong", "equivariance", lambda: kernel(change=lambda t: torch.cat([1.05 * t[:2], t[2:]]))),
    Mutant("even size", "lemma 2", lambda: kernel(size=32, correlation=of_even_size)),
    Mutant("frequency beyond the ring", "steerability", lambda: kernel(radii=(2.0, 3.0, 4.0))),
    Mutant("rings cut off by the edge", "steerability", lambda: kernel(radii=(8.5, 10.0, 16.0))),
    Mutant("1% noise", "steerability, wide band", lambda: kernel(change=noise(0.01))),
    Mutant("rounded to bfloat16", "steerability", lambda: kernel(change=lambda taps: taps.bfloat16().double())),
    Mutant("not steerable", "eq. 2, any turn", lambda: kernel(change=noise(30))),
    Mutant("convolution for correlation, odd frequencies", "correlation", lambda: _odd(_convolve)),
    Mutant("angles modulo 2 pi: odd frequencies", "mirror", lambda: _odd(correlate)),
    Mutant("wraps round the table", "correlation", lambda: kernel(correlation=wrapped)),
    Mutant(
        "fainter away from the middle",
        "translation",
        lambda: kernel(correlation=lambda f, k: vignette(correlate(f, k))),
    ),
    Mutant("off by one at even sizes", "lemma 2", lambda: kernel(correlation=at_even_sizes(off_by_one))),
    Mutant("wraps round the table at even sizes", "correlation", lambda: kernel(correlation=at_even_sizes(wrapped))),
    Mutant(
        "fainter away from the middle at even sizes",
        "translation",
        lambda: kernel(correlation=at_even_sizes(lambda f, k: vignette(correlate(f, k)))),
    ),
    Mutant("every scene by the first kernel", "correlation", lambda: kernel(correlation=by_the_first)),
    Mutant("shuffled bins", "bins turn", lambda: kernel(read_out=lambda matrix: matrix[shuffled(36)])),
    Mutant("bins off by one", "fourier", lambda: kernel(read_out=lambda matrix: matrix.roll(1, 0))),
    Mutant("36 bins over 2 pi", "eq. 2, whole bins", lambda: kernel(read_out=lambda m: m[2 * torch.arange(36) % 36])),
    Mutant("read-out transposed", "fourier", lambda: kernel(read_out=lambda m: m.T.reshape(m.shape))),
    Mutant("bins the other way round", "eq. 2, any turn", lambda: kernel(read_out=lambda m: m.flip(0))),
    Mutant("lift over C_90 called exact", "lift permutes", lambda: lift(order=90)),
    Mutant("lift without a disc", "lift turns", lambda: lift(disc=False)),
    Mutant("lift turns the wrong way", "lift permutes", lambda: lift(sign=-1)),
    Mutant("height scaled with the turn", "observations move", lambda: ActionSubject("taller", Motion, Taller())),
    Mutant("closing axis clockwise", "grasps move", lambda: ActionSubject("clockwise", Motion, Clockwise())),
    Mutant("composition in the wrong order", "group", lambda: ActionSubject("reversed", RightToLeft, WORKSPACE)),
    Mutant("phi off by one cell", "policy: quarter turn", lambda: policy(phi=lambda x: x.roll(1, 3))),
    Mutant(
        "phi blurs along one axis",
        "policy: quarter turn",
        lambda: policy(phi=lambda x: x + x.roll(1, 2) + x.roll(-1, 2)),
    ),
    Mutant(
        "a blur behind cells that are forbidden",
        "policy: quarter turn",
        lambda: policy(phi=lambda x: x + x.roll(1, 2) + x.roll(-1, 2), scores=forbidden),
    ),
    Mutant(
        "off by one behind cells that are forbidden, in float32",
        "policy: quarter turn",
        lambda: policy(phi=lambda x: x.roll(1, 3), scores=lambda s: forbidden(s / 1000), dtype=torch.float32),
    ),
    Mutant("phi looks for edges along rows", "policy: quarter turn", lambda: _unbounded(phi=edges)),
    Mutant("phi blurs what is dark along rows", "policy: quarter turn", lambda: _unbounded(phi=darker)),
    Mutant(
        "phi takes the table's colour from the first column",
        "policy: quarter turn",
        lambda: _unbounded(phi=beside_the_first_column),
    ),
    Mutant("phi off by one cell where policies act", "policy: quarter turn", lambda: _unbounded(phi=off_where_acting)),
    Mutant("phi torn where policies act", "policy: translation", lambda: _unbounded(phi=torn_where_acting)),
    Mutant("policy with a wrong sign", "policy: eq. 2, any turn", lambda: policy(change=clockwise)),
    Mutant(
        "policy with a mirrored kernel", "policy: eq. 2, any turn", lambda: policy(change=lambda taps: taps.flip(2))
    ),
    Mutant("policy with frequency 6 turned the other way", "policy: whole bins", lambda: policy(change=sign_of(6))),
    Mutant("policy with frequency 8 turned the other way", "policy: whole bins", lambda: policy(change=sign_of(8))),
    Mutant("policy with stronger taps in four directions", "policy: whole bins", lambda: policy(change=uneven)),
    Mutant("policy with a kernel cut to a square", "policy: whole bins", lambda: policy(change=square)),
    Mutant("policy with shuffled bins", "policy: eq. 2, quarter turns", lambda: policy(bins=lambda m: m[shuffled(36)])),
    Mutant("right half of the table torn", "policy: translation", lambda: policy(phi=torn)),
    Mutant("phi sees further than it says", "policy: eq. 2, every score", lambda: policy(phi=glancing)),
    Mutant("phi wraps round the table", "policy: field of view", lambda: policy(correlation=wrapped)),
    Mutant("phi normalised over the whole table", "policy: field of view", lambda: policy(phi=normalised)),
    Mutant("phi normalised over the whole batch", "policy: field of view", lambda: policy(phi=normalised_by_batch)),
)
"""Every mutant is killed by its law, and every law kills a mutant: `test_broken_kernels.py`."""


def _unbounded(phi: Change) -> PolicySubject:
    """A policy that does not say how far it sees, and so is looked at on tables of two sizes."""
    return replace(policy(phi=phi), reach=None)


def _convolve(features: Tensor, taps: Tensor) -> Tensor:
    return correlate(features, taps.flip((3, 4)))
