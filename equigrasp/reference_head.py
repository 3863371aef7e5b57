"""The head as the paper says it, word by word: lift in space, correlate every turn, Fourier-transform what comes out.

    psi(l) --lift--> n images --each correlated with phi--> n maps --Fourier over C_n--> even irreps --> 36 bins

`LegPolicy` with a `LiftedKernel` gives the same scores: the Fourier transform over the group is linear and acts on
j alone, so that it may be put before the correlation, where it acts on a kernel and not on n maps of the table.
This one is kept to be compared with (`tests/test_reference_head.py`), and raced against (`equigrasp bench --against
literal`). It is built step by step from `turn_matrix`, and shares with the other its image psi and its scale alone.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.constant import Constant
from equigrasp.correlation import Correlation, correlate
from equigrasp.errors import InputError
from equigrasp.kernel import LiftedKernel
from equigrasp.kernel.lift import frequency_weights, lift_matrix, soft_disc, turn_matrix
from equigrasp.policy import GraspPolicy, LegPolicy


class LiteralHead(nn.Module):
    """kappa(l) and its correlation in the paper's order (LEG, the lift and the Fourier transform; A.2.3).

    Args:
        kappa: whose psi is lifted, and whose frequencies are kept.
        group_order: n, that kappa was made with.
        correlation: how the n images are correlated with the features.

    Raises:
        InputError: if C_n is odd or does not carry the kernel's frequencies.
    """

    def __init__(self, kappa: LiftedKernel, group_order: int, correlation: Correlation = correlate) -> None:
        super().__init__()
        frequency = kappa.out_type.size - 1
        if group_order % 2 or group_order <= 2 * frequency:
            raise InputError(
                f"C_{group_order} does not carry frequency {frequency}; use an even order above {2 * frequency}"
            )
        self.psi = kappa.psi
        self.size = kappa.size
        self.out_type = kappa.out_type
        self.correlation = correlation
        # LiftedKernel's scale, by which a white psi gives a kernel of about unit length
        weights = frequency_weights(frequency)
        lift = lift_matrix(kappa.size, frequency, group_order) * weights[:, None, None]
        scale = 1 / (2 * math.sqrt(kappa.channels) * lift.norm())
        angles = [2 * math.pi * j / group_order for j in range(group_order)]
        self.turns = Constant(torch.stack([scale * turn_matrix(kappa.size, angle) for angle in angles]))
        self.disc = Constant(soft_disc(kappa.size).view(kappa.size, kappa.size))
        theta = torch.tensor(angles, dtype=torch.float64)
        rows = [torch.ones_like(theta)]
        for m in range(2, frequency + 1, 2):
            rows += [2 * torch.cos(m * theta), 2 * torch.sin(m * theta)]
        self.fourier = Constant(weights[:, None] * torch.stack(rows) / group_order)

    def lift(self, psi: Tensor) -> Tensor:
        """An image `(B, C, k, k)` -> its turns L_j(x) = psi(R(-theta_j) x), `(B, n, C, k, k)`, under the disc."""
        windowed = (psi * self.disc.value).flatten(2)
        turned = torch.einsum("npq,bcq->bncp", self.turns.value, windowed)
        return turned.unflatten(3, (self.size, self.size))

    def forward(self, features: Tensor, embedding: Tensor) -> Tensor:
        """`(B, C, H, W)` and `(B, D)` -> the score in even irreps, `(B, out_type.size, H, W)`."""
        psi = self.psi(embedding)
        with torch.autocast(features.device.type, enabled=False):
            exact = torch.promote_types(features.dtype, torch.float32)
            regular = self.correlation(features.to(exact), self.lift(psi.to(exact)))
            return torch.einsum("on,bnhw->bohw", self.fourier.value, regular)


class LiteralPolicy(GraspPolicy):
    """A `LegPolicy` of a lifted kernel whose scores are computed in the paper's order.

    Args:
        policy: whose phi, psi and read-out these are; the two share their weights.
        group_order: n, that its kernel was made with.
        correlation: as `LiteralHead`.

    Raises:
        InputError: if the policy has no lifted kernel.
    """

    def __init__(self, policy: GraspPolicy, group_order: int, correlation: Correlation = correlate) -> None:
        if not isinstance(policy, LegPolicy) or not isinstance(policy.kappa, LiftedKernel):
            raise InputError("the literal reading is one of a lifted kernel, which this model has not; see leg-unet")
        super().__init__(policy.stride, policy.text_encoder, policy.precision, policy.bins)
        self.phi = policy.phi
        self.head = LiteralHead(policy.kappa, group_order, correlation)
        self.synthesis = Constant(fields.synthesis(self.head.out_type.size - 1, policy.bins))

    def score(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """The field's values at the angles of the bins."""
        field = self.head(self.phi(observation, embedding), embedding)
        with torch.autocast(observation.device.type, enabled=False):
            return torch.einsum("io,bohw->bihw", self.synthesis.value, field)


def correlate_directly(features: Tensor, kernel: Tensor) -> Tensor:
    """`correlate` by its definition, a sum over the kernel's pixels, as a convolution layer computes it.

    For checking, and for the race: the literal head's 72 x 8 kernels of 25 pixels take it seconds forward and backward.
    """
    batch, outputs, channels, size, _ = kernel.shape
    image = features.reshape(1, batch * channels, *features.shape[2:])
    filters = kernel.reshape(batch * outputs, channels, size, size)
    scores = functional.conv2d(image, filters, padding=size // 2, groups=batch)
    return scores.unflatten(1, (batch, outputs))[0]
