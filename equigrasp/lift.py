"""The lift of an image over C_n and its Fourier transform over C_n, as one matrix (LEG, the lift; A.2.3).

All here is linear in the image and made once, in float64. Images are flattened, `(k * k,)`, rows first.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from equigrasp import fields


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
