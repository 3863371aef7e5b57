"""Scenes as functions of the plane: a turned scene is evaluated, never interpolated.

Turning pixels costs more than the errors that the laws look for: bilinear interpolation of an image with content up
to half the Nyquist limit is wrong by 1e-1, bicubic by 3e-2. So a scene here is a formula, o: R^2 -> R^C, and T_g o is
the formula at g^-1 x. Points are `(P, 2)` x, y in pixels with y up, values `(C, P)`, both float64.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

Scene = Callable[[Tensor], Tensor]

QUARTER_BAND = 0.25 * math.pi
"""Radians a pixel: a quarter of the Nyquist limit, a period of 8 pixels."""
HALF_BAND = 0.5 * math.pi


def turn(degrees: float) -> Tensor:
    """R(degrees), `(2, 2)` float64, counter-clockwise with y up; exact at quarter turns."""
    if degrees % 90 == 0:
        c, s = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][int(degrees // 90) % 4]
    else:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return torch.tensor([[c, -s], [s, c]], dtype=torch.float64)


@dataclass(frozen=True)
class PlaneMotion:
    """g: x -> R(degrees) (x - about) + about + shift, in pixels with y up."""

    degrees: float
    shift: tuple[float, float] = (0.0, 0.0)
    about: tuple[float, float] = (0.0, 0.0)

    def __call__(self, points: Tensor) -> Tensor:
        """Move points `(P, 2)`."""
        about, shift = points.new_tensor(self.about), points.new_tensor(self.shift)
        return (points - about) @ turn(self.degrees).T + about + shift

    def inverse(self, points: Tensor) -> Tensor:
        """Undo the motion of points `(P, 2)`."""
        about, shift = points.new_tensor(self.about), points.new_tensor(self.shift)
        # a row vector times R is R inverse on a column
        return (points - shift - about) @ turn(self.degrees) + about


def moved(scene: Scene, motion: PlaneMotion) -> Scene:
    """T_g o: x -> o(g^-1 x)."""
    return lambda points: scene(motion.inverse(points))


@dataclass(frozen=True, eq=False)
class Waves:
    """A sum of plane waves.

    Attributes:
        amplitude: `(C, N)`.
        vectors: `(N, 2)` radians a pixel.
        phase: `(C, N)` radians.
    """

    amplitude: Tensor
    vectors: Tensor
    phase: Tensor

    def __call__(self, points: Tensor) -> Tensor:
        """Values at points `(P, 2)`, `(C, P)`."""
        return torch.einsum("cn,cnp->cp", self.amplitude, torch.cos(self.vectors @ points.T + self.phase[..., None]))

    @property
    def band(self) -> float:
        """The longest wave vector, radians a pixel."""
        return float(self.vectors.norm(dim=1).max())


def waves(channels: int, band: float, seed: int, count: int = 16) -> Waves:
    """Random plane waves, uniform in the disc |k| <= band."""
    rng = torch.Generator().manual_seed(seed)
    direction = 2 * math.pi * torch.rand(count, 1, dtype=torch.float64, generator=rng)
    length = band * torch.rand(count, 1, dtype=torch.float64, generator=rng).sqrt()
    return Waves(
        torch.randn(channels, count, dtype=torch.float64, generator=rng),
        length * torch.cat([direction.cos(), direction.sin()], dim=1),
        2 * math.pi * torch.rand(channels, count, dtype=torch.float64, generator=rng),
    )


@dataclass(frozen=True, eq=False)
class Blobs:
    """An object: Gaussians of one width, all within `radius` of its centre.

    A Gaussian of width s has exp(-(s k)^2) of its spectral energy beyond the wave number k: with s = 3 pixels that
    is 3e-10 beyond half the Nyquist limit.

    Attributes:
        weight: `(C, N)`.
        centres: `(N, 2)` relative to `centre`, pixels.
        centre: x, y in pixels.
        width: s, pixels.
    """

    weight: Tensor
    centres: Tensor
    centre: tuple[float, float] = (0.0, 0.0)
    width: float = 3.0

    def __call__(self, points: Tensor) -> Tensor:
        """Values at points `(P, 2)`, `(C, P)`."""
        local = points - points.new_tensor(self.centre)
        # beyond 6 widths a Gaussian is 1e-8
        near = (local.norm(dim=1) <= float(self.centres.norm(dim=1).max()) + 6 * self.width).nonzero()[:, 0]
        x = torch.exp(-((local[near, :1] - self.centres[:, 0]) ** 2) / (2 * self.width**2))
        y = torch.exp(-((local[near, 1:] - self.centres[:, 1]) ** 2) / (2 * self.width**2))
        values = points.new_zeros(len(self.weight), len(points))
        values[:, near] = self.weight @ (x * y).T
        return values

    @property
    def radius(self) -> float:
        """Everything above a thousandth of the peak lies within this of the centre, pixels."""
        return float(self.centres.norm(dim=1).max()) + 3.7 * self.width


def blobs(
    channels: int, seed: int, count: int = 6, spread: float = 8.0, width: float = 3.0, positive: bool = False
) -> Blobs:
    """A random object of `count` Gaussians of that width, their centres uniform in a disc of radius `spread`."""
    rng = torch.Generator().manual_seed(seed)
    angle = 2 * math.pi * torch.rand(count, 1, dtype=torch.float64, generator=rng)
    length = spread * torch.rand(count, 1, dtype=torch.float64, generator=rng).sqrt()
    weight = torch.randn(channels, count, dtype=torch.float64, generator=rng)
    centres = length * torch.cat([angle.cos(), angle.sin()], dim=1)
    return Blobs(weight.abs() if positive else weight, centres, width=width)


def meant(kernel: Tensor, angle: Tensor, width: float = 1.5) -> Blobs:
    """The object that a kernel means: what it answers to most, at its own centre and one angle.

    By Cauchy-Schwarz a scene equal to the kernel's row for that angle has the highest score of all scenes of its
    norm there; smoothed by Gaussians it can be evaluated anywhere. Language makes kernels, so that this object
    stands for the one that the instruction names.

    Args:
        kernel: `(O, C, k, k)`.
        angle: `(O,)`, the row of the read-out.
        width: of the Gaussians, pixels.
    """
    size = kernel.shape[-1]
    points = lattice(size, size)
    kept = points.norm(dim=1) <= size // 2
    weight = torch.einsum("o,ocp->cp", angle, kernel.flatten(2)).double()[:, kept]
    return Blobs(weight * (len(points) ** 0.5 / weight.norm()), points[kept], width=width)


@dataclass(frozen=True, eq=False)
class Arrangement:
    """One target among fixed others: what Eq. 2 is about.

    Attributes:
        target: the object that the instruction means.
        others: what stays where it is.
    """

    target: Blobs
    others: tuple[Blobs, ...]

    def __call__(self, points: Tensor) -> Tensor:
        """Values at points `(P, 2)`, `(C, P)`."""
        return sum((each(points) for each in self.others), self.target(points))

    def with_target_moved(self, motion: PlaneMotion) -> Scene:
        """The same scene with the target alone moved by g."""
        target = moved(self.target, motion)
        return lambda points: sum((each(points) for each in self.others), target(points))


def arrangement(
    channels: int,
    seed: int,
    slots: Sequence[tuple[float, float]],
    jitter: float = 2.0,
    quieter: float = 0.5,
    spread: float = 6.0,
    width: float = 2.5,
    positive: bool = False,
) -> Arrangement:
    """Random objects near fixed places, the target at a random one of them.

    Args:
        channels: C.
        seed: of everything random.
        slots: places, x, y in pixels; their distance decides whether one object's grasp can see another.
        jitter: how far an object may lie from its place, along each axis, pixels.
        quieter: the others' amplitude where the target's is 1, because the instruction means the target.
        spread: of the objects' Gaussians, pixels.
        width: of each Gaussian, pixels.
        positive: every weight positive, as heights are.
    """
    rng = torch.Generator().manual_seed(seed)
    order = torch.randperm(len(slots), generator=rng).tolist()
    objects = []
    for rank, index in enumerate(order):
        offset = jitter * (2 * torch.rand(2, dtype=torch.float64, generator=rng) - 1)
        centre = (slots[index][0] + float(offset[0]), slots[index][1] + float(offset[1]))
        own = int(torch.randint(2**31, (1,), generator=rng))
        thing = blobs(channels, own, spread=spread, width=width, positive=positive)
        weight = thing.weight * (1.0 if rank == 0 else quieter)
        objects.append(replace(thing, weight=weight, centre=centre))
    return Arrangement(objects[0], tuple(objects[1:]))


def lattice(rows: int, columns: int) -> Tensor:
    """Pixel centres `(rows * columns, 2)` x, y, rows first; the origin is pixel (rows // 2, columns // 2)."""
    y, x = torch.meshgrid(
        rows // 2 - torch.arange(rows, dtype=torch.float64),
        torch.arange(columns, dtype=torch.float64) - columns // 2,
        indexing="ij",
    )
    return torch.stack([x.reshape(-1), y.reshape(-1)], dim=1)


def render(scene: Scene, rows: int, columns: int) -> Tensor:
    """The scene at every pixel of `lattice`, `(C, rows, columns)` float64."""
    return scene(lattice(rows, columns)).unflatten(1, (rows, columns))
