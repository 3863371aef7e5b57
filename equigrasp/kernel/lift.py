"""The lift of an image over C_n and its Fourier transform over C_n, as one matrix (LEG, the lift; A.2.3).

All here is linear in the image, and its matrices are made once, in float64. In them images are flattened, `(k * k,)`,
rows first.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.constant import Constant


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

    # turn by turn: all of them at once, unfolded, took 700 MiB for 33 pixels
    def fold(angle: Tensor) -> Tensor:
        turn = (turn_matrix(size, float(angle)) * window)[:upper]
        half = (turn + turn.flip(1))[:, :upper] / 2
        half[:, -1] /= 2
        return half

    folded = torch.stack([fold(angle) for angle in theta])
    transform = [torch.ones_like(theta)]
    for m in range(2, maximum_frequency + 1, 2):
        transform += [2 * torch.cos(m * theta), 2 * torch.sin(m * theta)]
    return torch.einsum("oj,jpq->opq", torch.stack(transform), folded) / len(theta)


def frequency_weights(maximum_frequency: int) -> Tensor:
    """By what each even frequency of a lift is multiplied, 1 + m / 2, `(1 + maximum_frequency,)` float64.

    An image has ever less of a higher frequency, and scores that are to tell one angle from the next need it. One
    factor for a whole irrep commutes with its turns.
    """
    frequencies = [0, *(m for m in range(2, maximum_frequency + 1, 2) for _ in range(2))]
    return 1 + torch.tensor(frequencies, dtype=torch.float64) / 2


class HalfTurnLift(nn.Module):
    """psi `(B, C, k, k)` -> the kernel that its turns make, `(B, O, C, k, k)`, by half of its pixels; for any even n.

    Args:
        matrix: `lift_matrix` times any scale.
        size: k.
    """

    def __init__(self, matrix: Tensor, size: int) -> None:
        super().__init__()
        self.size = size
        self.matrix = Constant(matrix.flatten(0, 1))

    def forward(self, psi: Tensor) -> Tensor:
        """`(B, C, k, k)` -> `(B, O, C, k, k)`."""
        psi, matrix = psi.flatten(2), self.matrix.value
        upper = matrix.shape[1]
        kernel = functional.linear((psi + psi.flip(2))[..., :upper], matrix).unflatten(2, (-1, upper))
        kernel = torch.cat([kernel, kernel[..., :-1].flip(3)], dim=3)
        return kernel.unflatten(3, (self.size, self.size)).transpose(1, 2)


class QuarterTurnLift(nn.Module):
    """`HalfTurnLift` by a quarter of the pixels and a quarter of the work, where C_n has the turn T by 90 degrees.

    T takes a coefficient of frequency m to (-1)^(m/2) times itself: multiples of 4 depend on psi + T^2 psi plus its
    quarter turn alone, the others on it minus its quarter turn. Both, and what comes out, are known everywhere from the
    first (k - 1) / 2 rows of (k + 1) / 2 pixels, whose four turns cover the image but for its centre.

    Args:
        matrix: `lift_matrix` times any scale, of an n that is a multiple of 4.
        size: k.
    """

    def __init__(self, matrix: Tensor, size: int) -> None:
        super().__init__()
        self.size = size
        centre = matrix.shape[1] - 1
        index = torch.arange(size**2).view(size, size)
        own = self._block(index).flatten()
        beside = self._block(index.rot90()).flatten()
        # of the two pixels x and -x the first half has one
        beside = torch.minimum(beside, 2 * centre - beside)
        self.signs = [1 if (output + 1) // 2 % 2 == 0 else -1 for output in range(len(matrix))]
        """Of a quarter turn, for 0 and then a cosine and a sine of 2, 4, .."""
        whole, half = ([each for each, sign in zip(matrix, self.signs, strict=True) if sign == one] for one in (1, -1))
        at = torch.cat([own, torch.tensor([centre])])
        self.plus = Constant(torch.stack([_folded(each[at], own, beside, 1, [centre]) for each in whole]))
        self.minus = Constant(
            torch.stack([_folded(each[own], own, beside, -1, []) for each in half])
            if half
            else matrix.new_zeros(0, len(own), len(own))
        )

    def forward(self, psi: Tensor) -> Tensor:
        """`(B, C, k, k)` -> `(B, O, C, k, k)`."""
        even = psi + psi.flip((2, 3))
        turned = even.rot90(1, (2, 3))
        middle = even[:, :, self.size // 2, self.size // 2, None]
        sums = torch.cat([self._block(even + turned).flatten(2), 2 * middle], dim=2)
        differences = self._block(even - turned).flatten(2)
        whole = functional.linear(sums, self.plus.value.flatten(0, 1)).unflatten(2, self.plus.value.shape[:2])
        half = functional.linear(differences, self.minus.value.flatten(0, 1)).unflatten(2, self.minus.value.shape[:2])
        whole = self._spread(whole[..., :-1], whole[..., -1:], 1)
        half = self._spread(half, torch.zeros_like(half[..., :1]), -1)
        parts = {1: iter(whole.unbind(2)), -1: iter(half.unbind(2))}
        kernel = torch.stack([next(parts[sign]) for sign in self.signs], dim=1)
        return kernel.unflatten(3, (self.size, self.size))

    def _block(self, image: Tensor) -> Tensor:
        return image[..., : self.size // 2, : self.size // 2 + 1]

    def _spread(self, block: Tensor, centre: Tensor, sign: int) -> Tensor:
        """What is known on the first block and in the centre, everywhere: `(.., (k * k - 1) / 4)` -> `(.., k * k)`."""
        block = block.unflatten(-1, (self.size // 2, self.size // 2 + 1))
        beside = sign * block.rot90(-1, (-2, -1))
        rows = torch.cat([block, beside[..., :-1, :]], dim=-1).flatten(-2)
        upper = torch.cat([rows, beside[..., -1, :].flip(-1)], dim=-1)
        return torch.cat([upper, centre, upper.flip(-1)], dim=-1)


def _folded(matrix: Tensor, own: Tensor, beside: Tensor, sign: int, alone: list[int]) -> Tensor:
    """Rows over pixels -> rows over pixels plus or minus their quarter turns, and over twice those that have none."""
    pairs = matrix[:, own] + sign * matrix[:, beside]
    return torch.cat([pairs, matrix[:, alone]], dim=1) / 2
