"""kappa(l): from the embedding of an instruction to a kernel that turns scalars into scores over angles.

Every kernel K(l) here is a field on the pixel grid whose type is declared by `in_type` (scalars) and `out_type`
(even irreps), and obeys, up to its own measured error, the steerability constraint of LEG (the lemma behind
Eq. 2), written for world y up:

    K(g x) = rho_out(g) K(x)        for every rotation g about the kernel's centre.

Correlating phi(o) with it then gives a field that turns with the scene, f(T_g o) = T_g rho_out(g) f(o).
Embeddings are `(B, D)` of unit length; kernels are `(B, out_type.size, C, k, k)`, rows first, row 0 at the top.
"""

from __future__ import annotations

import copy
import math

import torch
from escnn.kernels import kernels_SO2_act_R2
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.errors import InputError


class SteerableKernel(nn.Module):
    """The exact construction: the instruction weighs the elements of escnn's trivial -> irrep basis.

    The basis is the solution of the constraint in polar coordinates, Gaussian rings times circular harmonics.
    On a grid it is exact only as far as the grid can carry it, so rings end `margin` pixels inside the kernel's
    edge, and a ring of radius r carries frequencies up to 1.5 (r - sigma). Then the constraint holds to 1e-12 at
    quarter turns and to 2e-4 at any angle for inputs below a quarter of the sampling rate's Nyquist limit.

    Args:
        embedding_size: D.
        channels: C, of phi's features.
        size: k, in read-out pixels; odd.
        maximum_frequency: even; None for the highest that the rings carry (16 for 33 pixels).
        hidden: width of the two hidden layers between the embedding and the coefficients.
        margin: pixels from the outermost ring to the kernel's edge.

    Raises:
        InputError: if the size is even, too small for a ring, or too small for the frequency.
    """

    sigma = 0.8
    cutoff = 1.5

    def __init__(
        self,
        embedding_size: int,
        channels: int = 8,
        size: int = 33,
        maximum_frequency: int | None = None,
        hidden: int = 256,
        margin: float = 4.0,
    ) -> None:
        super().__init__()
        check_size(size)
        radii = [float(r) for r in range(2, math.floor(size / 2 - margin) + 1)]
        if not radii:
            raise InputError(
                f"a kernel of {size} pixels has no room for a ring {margin} pixels inside its edge; "
                f"use an odd size of {2 * math.ceil(2 + margin) - 1} or more"
            )
        carried = int(self.cutoff * (radii[-1] - self.sigma)) // 2 * 2
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

        self.frequencies = range(0, maximum_frequency + 1, 2)
        bases = [self._basis(m, radii) for m in self.frequencies]
        self.elements = [len(basis) for basis in bases]
        scale = 1 / math.sqrt(channels * sum(self.elements))
        for m, basis in zip(self.frequencies, bases, strict=True):
            self.register_buffer(f"basis_{m}", (scale * basis).float(), persistent=False)
        self.coefficients = nn.Sequential(
            nn.Linear(embedding_size, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, channels * sum(self.elements)),
        )

    def _basis(self, m: int, radii: list[float]) -> Tensor:
        """Elements of frequency m, each of unit length, `(n, 1 or 2, k * k)` float64."""
        radii = [r for r in radii if m <= max(0.0, self.cutoff * (r - self.sigma))]
        space = fields.gspace()
        irrep = space.fibergroup.irrep(m)
        shared = kernels_SO2_act_R2(space.trivial_repr, irrep, radii, self.sigma, maximum_frequency=m)
        # escnn caches bases for the whole process: a copy, or .double() would change everyone's
        basis = copy.deepcopy(shared).double().sample(fields.grid(self.size))
        basis = basis[..., 0].permute(1, 2, 0)
        return basis / basis.flatten(1).norm(dim=1)[:, None, None]

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, D)` -> `(B, out_type.size, C, k, k)`."""
        weights = self.coefficients(embedding * math.sqrt(embedding.shape[1]))
        weights = weights.unflatten(1, (self.channels, -1)).split(self.elements, dim=2)
        bases = [self.get_buffer(f"basis_{m}") for m in self.frequencies]
        parts = [torch.einsum("bcn,ndp->bdcp", weight, basis) for weight, basis in zip(weights, bases, strict=True)]
        return torch.cat(parts, dim=1).unflatten(3, (self.size, self.size))


class LiftedKernel(nn.Module):
    """The paper's construction: an image psi(l), turned by every element of C_n, Fourier-transformed over C_n.

    psi(l), `(B, C, k, k)`, comes from a small U-Net on the tiled embedding and fades out in a soft disc. Its lift
    is the regular field L(x, theta_j) = psi(R(-theta_j) x), theta_j = 2 pi j / n, by bicubic interpolation. The
    even frequencies of L over j are the kernel. Disc, turns and transform are linear in psi and do not depend on
    the instruction, so they are one matrix, made once in float64 (LEG, the lift and the Fourier transform of kappa).

    The constraint holds exactly at quarter turns, and elsewhere as well as psi can be interpolated: to 4e-2 for
    white noise, 2e-3 .. 8e-3 for a smooth psi.

    Args:
        embedding_size: D.
        channels: C, of phi's features.
        size: k, in read-out pixels; odd.
        maximum_frequency: even.
        group_order: n; a multiple of 4, because C_n must contain the quarter turns that a grid has.
        exact_quarter_turns: False allows another n, as the paper's own 90: its error at 90 degrees is 0.1.
        widths: channels of psi's three scales.

    Raises:
        InputError: if the size is even, or n is too small or not a multiple of 4.
    """

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
        self.psi = KernelImage(embedding_size, channels, size, widths)
        lift = lift_matrix(size, maximum_frequency, group_order)
        # a white psi of unit variance gives a kernel of about unit length
        lift /= 2 * math.sqrt(channels) * lift.norm()
        self.register_buffer("lift", lift.flatten(0, 1).float(), persistent=False)

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, D)` -> `(B, out_type.size, C, k, k)`."""
        return self.turn(self.psi(embedding))

    def turn(self, psi: Tensor) -> Tensor:
        """An image `(B, C, k, k)` -> the kernel that its turns make, `(B, out_type.size, C, k, k)`."""
        psi = psi.flatten(2)
        lift = self.get_buffer("lift")
        upper = lift.shape[1]
        kernel = functional.linear((psi + psi.flip(2))[..., :upper], lift).unflatten(2, (-1, upper))
        kernel = torch.cat([kernel, kernel[..., :-1].flip(3)], dim=3)
        return kernel.unflatten(3, (self.size, self.size)).transpose(1, 2)


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
        tiled = language[:, :, None, None].expand(-1, -1, *third.shape[2:])
        third = self.bottom(torch.cat([third, tiled], dim=1))
        x = self.up_second(torch.cat([_resize(third, second), second], dim=1))
        x = self.up_first(torch.cat([_resize(x, first), first], dim=1))
        return self.out(x)


def _block(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1, bias=False), nn.GroupNorm(8, outputs), nn.ReLU(inplace=True)
    )


def _resize(x: Tensor, like: Tensor) -> Tensor:
    return functional.interpolate(x, size=like.shape[2:], mode="bilinear", align_corners=False)


def check_size(size: int) -> None:
    """Raise an InputError unless the kernel has a centre pixel: an even size is off centre by half a pixel."""
    if size % 2 == 0 or size < 1:
        raise InputError(
            f"a kernel turns about its centre pixel, so its size is odd, but this is {size}; "
            f"use {size - 1 if size > 1 else 1} or {size + 1}"
        )


def soft_disc(size: int) -> Tensor:
    """A window on the kernel's pixels, `(k * k,)` float64: 1 inside, a raised cosine to 0 one pixel from the edge."""
    radius = fields.grid(size).norm(dim=1)
    outer = size / 2 - 1
    inner = max(0.0, outer - max(4.0, size / 6))
    ramp = ((radius - inner) / (outer - inner)).clamp(0, 1)
    return (1 + torch.cos(math.pi * ramp)) / 2


def turn_matrix(size: int, angle: float) -> Tensor:
    """The turn of an image by an angle as a matrix, `(k * k, k * k)` float64: (T psi)(x) = psi(R(-angle) x).

    Counter-clockwise with y up, bicubic (Keys, a = -1/2), zero outside; a permutation at quarter turns.
    """
    points = fields.grid(size)
    c, s = math.cos(angle), math.sin(angle)
    # rounded, so that a quarter turn lands on pixel centres and not 1e-15 beside them
    x = (c * points[:, 0] + s * points[:, 1]).mul(2**30).round().div(2**30)
    y = (-s * points[:, 0] + c * points[:, 1]).mul(2**30).round().div(2**30)
    column, row = x + (size - 1) / 2, (size - 1) / 2 - y
    weights_row, weights_column = _bicubic(row, size), _bicubic(column, size)
    return (weights_row[:, :, None] * weights_column[:, None, :]).flatten(1)


def _bicubic(position: Tensor, size: int) -> Tensor:
    """Interpolation weights of a line of pixels at fractional positions, `(points, k)`."""
    t = (position[:, None] - torch.arange(size, dtype=position.dtype)).abs()
    near = 1.5 * t**3 - 2.5 * t**2 + 1
    far = -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2
    return torch.where(t <= 1, near, torch.where(t < 2, far, torch.zeros_like(t)))


def lift_matrix(size: int, maximum_frequency: int, group_order: int) -> Tensor:
    """From psi to the even irreps of its lift over C_n, `(1 + maximum_frequency, h, h)` float64, h = (k * k + 1) / 2.

    Even frequencies do not tell x from -x: psi(x) + psi(-x) goes in and K(x) comes out on the first h pixels,
    which are one of each such pair and the centre; and turns by theta and theta + pi count once.
    """
    upper = (size**2 + 1) // 2
    theta = torch.arange(group_order // 2, dtype=torch.float64) * (2 * math.pi / group_order)
    window = soft_disc(size)
    turns = torch.stack([(turn_matrix(size, float(angle)) * window)[:upper] for angle in theta])
    folded = (turns + turns.flip(2))[..., :upper] / 2
    folded[..., -1] /= 2
    transform = [torch.ones_like(theta)]
    for m in range(2, maximum_frequency + 1, 2):
        transform += [2 * torch.cos(m * theta), 2 * torch.sin(m * theta)]
    return torch.einsum("oj,jpq->opq", torch.stack(transform), folded) / len(theta)
