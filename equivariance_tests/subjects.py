"""What laws are aimed at: a kernel, a policy, a lift, a group action.

A *kernel* is a module with escnn types `in_type` and `out_type` that makes, from embeddings `(B, D)`, kernels
`(B, out_type.size, in_type.size, k, k)`, rows first, row 0 at the top. A *policy* is a module that makes, from
observations `(B, 4, H, W)` and embeddings, scores `(B, bins, H / stride, W / stride)`. Both say D as `embedding_size`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.correlation import correlate
from equigrasp.workspace import WORKSPACE, Motion, Workspace

SIDES = (128, 160)
"""Pixels: four cells of a U-Net's coarsest grid, and five as where policies act: a grid that has a middle."""


@dataclass(frozen=True, eq=False)
class KernelSubject:
    """A kernel with phi = identity: correlated with a scene as it is, and read out into bins.

    Attributes:
        name: for reports.
        generate: `(1, D)` -> `(1, O, C, k, k)`.
        embedding_size: D.
        in_type: of the scene.
        out_type: of the correlation's result.
        dtype: of the kernels.
        read_out: `(bins, O)`, from the result to scores over angles; None if `out_type` is no such score.
        correlate: `(B, C, H, W)`, `(B, O, C, k, k)` -> `(B, O, H, W)`.
    """

    name: str
    generate: Callable[[Tensor], Tensor]
    embedding_size: int
    in_type: fields.FieldType
    out_type: fields.FieldType
    dtype: torch.dtype
    read_out: Tensor | None = None
    correlate: Callable[[Tensor, Tensor], Tensor] = correlate

    @property
    def group_order(self) -> int:
        """How many turns its group has; 0 where that has all of them."""
        return order_of(self.out_type)

    @property
    def bins(self) -> int:
        """Angles in [0, pi) that are scored; the workspace's where nothing is read out."""
        return WORKSPACE.bins if self.read_out is None else len(self.read_out)

    def kernel(self, seed: int) -> Tensor:
        """The kernel of a random unit embedding, `(O, C, k, k)`."""
        embedding = torch.randn(1, self.embedding_size, generator=torch.Generator().manual_seed(seed))
        with torch.no_grad():
            return self.generate(nn.functional.normalize(embedding).to(self.dtype))[0]


@dataclass(frozen=True, eq=False)
class PolicySubject:
    """A whole policy.

    Attributes:
        name: for reports.
        scores: `(B, 4, H, W)`, `(B, D)` -> `(B, bins, h, w)`.
        embedding_size: D.
        dtype: of its parameters.
        stride: heightmap pixels a cell of the scores.
        reach: how far a score sees from its cell's centre along each axis, heightmap pixels; None where that is not
            said. Who says it says as well that nothing but the cell's place among others of its size
            (`stride`, and 2 pixels at least) matters.
        bins: angles in [0, pi) that are scored.
        declared: how many turns its types have where they say C_n, as those of a phi over C_4; 0 where they say SO(2)
            or nothing.
        sides: heightmap pixels a side of the squares that it is shown, by turns; without a reach its tables are as
            high, and twice as wide.
    """

    name: str
    scores: Callable[[Tensor, Tensor], Tensor]
    embedding_size: int
    dtype: torch.dtype
    stride: int
    reach: float | None = None
    bins: int = WORKSPACE.bins
    declared: int = 0
    sides: tuple[int, ...] = SIDES

    def side(self, seed: int) -> int:
        """Pixels a side of a case's scenes, by its seed."""
        return self.sides[seed % len(self.sides)]


@dataclass(frozen=True, eq=False)
class LiftSubject:
    """The lift of an image over C_n (A.2.3).

    Attributes:
        name: for reports.
        lift: psi `(C, k * k)` -> `(n, C, k * k)`, psi turned by 2 pi j / n.
        order: n.
        size: k.
    """

    name: str
    lift: Callable[[Tensor], Tensor]
    order: int
    size: int
    dtype: torch.dtype = torch.float64


@dataclass(frozen=True, eq=False)
class ActionSubject:
    """How SE(2) acts on grasps, poses and observations.

    Attributes:
        name: for reports.
        motion: angle in radians, x and y in metres -> a group element with `@`, `inverse` and a call on points.
        workspace: has `move_grasp` and `move_observation`.
    """

    name: str
    motion: Callable[[float, float, float], Motion] = Motion
    workspace: Workspace = field(default_factory=lambda: WORKSPACE)
    dtype: torch.dtype = torch.float64


def order_of(kind: fields.FieldType) -> int:
    """How many turns the group of a type has; 0 where that has all of them."""
    group = kind.gspace.fibergroup
    return 0 if group.continuous else group.order()


def turns_as_waves(kind: fields.FieldType) -> bool:
    """Whether a type is (a0, a2, b2, a4, b4, ..): a constant, then a cosine and a sine of each even frequency."""
    group = kind.gspace.fibergroup
    degrees = 1.0 if group.continuous else 360 / group.order()
    found = representation(kind, degrees)
    if found is None or kind.size % 2 == 0:
        return False
    turns = 2 * math.radians(degrees) * torch.arange(1, (kind.size + 1) // 2, dtype=torch.float64)
    expected = torch.zeros_like(found)
    expected[0, 0] = 1
    for index, turn in enumerate(turns):
        c, s, at = torch.cos(turn), torch.sin(turn), 2 * index + 1
        expected[at : at + 2, at : at + 2] = torch.tensor([[c, -s], [s, c]], dtype=torch.float64)
    return torch.allclose(found, expected, 0.0, 1e-9)


def representation(kind: fields.FieldType, degrees: float) -> Tensor | None:
    """rho(g) of a type, `(size, size)` float64; None if its group has no turn by that angle."""
    group = kind.gspace.fibergroup
    if group.continuous:
        element = group.element(math.radians(degrees))
    else:
        steps = degrees * group.order() / 360
        if abs(steps - round(steps)) > 1e-9:
            return None
        element = group.element(round(steps) % group.order())
    return torch.from_numpy(kind.representation(element)).double()
