"""A kernel of a user's own, outside the package: all that the laws need of it."""

import torch
from torch import Tensor, nn

from equigrasp import fields


class RingKernel(nn.Module):
    """Gaussian rings times circular harmonics, weighed by the instruction."""

    embedding_size, size = 16, 25
    in_type, out_type = fields.trivial_type(3), fields.even_type(6)

    def __init__(self, sign: int = 1) -> None:
        super().__init__()
        x, y = fields.grid(self.size).T
        radius, angle = torch.hypot(x, y), torch.atan2(y, x)
        rings = torch.exp(-((radius - torch.tensor([[5.0], [6.5], [8.0]])) ** 2) / 2)
        waves = [torch.ones_like(angle)]  # and no angle at the centre, where it has no meaning
        for m in range(2, 7, 2):
            waves += [(radius > 0) * torch.cos(m * angle), sign * torch.sin(m * angle)]
        self.register_buffer("basis", torch.einsum("rp,op->orp", rings, torch.stack(waves)))
        self.weigh = nn.Linear(self.embedding_size, 3 * 4 * 3, dtype=torch.float64)

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, 16)` -> `(B, 7, 3, 25, 25)`: one weight for each channel, ring and frequency."""
        weights = self.weigh(embedding).view(-1, 3, 4, 3)[:, :, [0, 1, 1, 2, 2, 3, 3]]
        return torch.einsum("bcor,orp->bocp", weights, self.basis).unflatten(3, (self.size, self.size))


def make() -> RingKernel:
    """What `--policy my_kernel:make` measures."""
    return RingKernel()


def make_broken() -> RingKernel:
    """Its twin turns clockwise where it should turn counter-clockwise."""
    return RingKernel(sign=-1)
