"""Eq. 2 where the best grasp is not one: angles that tie, and scenes whose channels turn with the target."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor, nn

from equigrasp import fields
from equivariance_tests import LAWS, check_equivariance
from equivariance_tests.check import Report
from equivariance_tests.law import cases
from equivariance_tests.mutants import sign_of, square, uneven
from equivariance_tests.sound import EMBEDDING, Change, policy, same

EQ_2 = ["eq. 2, whole bins", "eq. 2, any turn"]
SIZE = 25


def rotations(frequencies: list[int], angle: Tensor) -> Tensor:
    """The direct sum of these irreps at each angle, `(P, size, size)`."""
    return torch.stack([torch.block_diag(*(_irrep(m, each) for m in frequencies)) for each in angle])


def _irrep(m: int, angle: Tensor) -> Tensor:
    cos, sin = torch.cos(m * angle), torch.sin(m * angle)
    return cos.view(1, 1) if m == 0 else torch.stack([torch.stack([cos, -sin]), torch.stack([sin, cos])])


class Between(nn.Module):
    """K(r, a) = rho_out(a) A(r) rho_in(a)^-1, which is Eq. 7 whatever A is: a kernel between any two types."""

    embedding_size = 8

    def __init__(self, into: list[int], out: list[int], bins: int = 36, sign: int = 1, aside: float = 0.0) -> None:
        super().__init__()
        space = fields.gspace()
        self.in_type, self.out_type = (
            fields.FieldType(space, [space.irrep(m) for m in frequencies]) for frequencies in (into, out)
        )
        # the score of an angle is what the irreps of a grasp at angle 0, turned by it, have in common with the field
        theta = torch.arange(bins, dtype=torch.float64) * math.pi / bins
        self.read_out = rotations(out, theta) @ torch.cat([torch.eye(2 if m else 1, 1) for m in out]).double()[:, 0]
        x, y = (fields.grid(SIZE) - torch.tensor([aside, 0.0])).T
        radius, angle = torch.hypot(x, y), torch.atan2(y, x)
        self.rings = (radius > 0) * torch.exp(-((radius - torch.tensor([[5.0], [6.5], [8.0]])) ** 2) / 2)
        self.left, self.right = rotations(out, angle), rotations([sign * m for m in into], angle)
        shape = (8, self.out_type.size, self.in_type.size, 3)
        rng = torch.Generator().manual_seed(0)
        self.between = nn.Parameter(torch.randn(*shape, generator=rng, dtype=torch.float64))

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, 8)` -> `(B, out, in, SIZE, SIZE)`."""
        between = torch.einsum("be,eoir,rp->bpoi", embedding, self.between, self.rings)
        kernel = torch.einsum("poq,bpqi,pji->bojp", self.left, between, self.right)
        return kernel.unflatten(3, (SIZE, SIZE))


def holds(report: Report) -> list[bool]:
    return [finding.status == "holds" for finding in report.findings]


@pytest.mark.parametrize("bins", [36, 1])
def test_where_every_angle_is_as_good_none_is_wrong(bins: int) -> None:
    """Frequency 0 alone: Eq. 2 is about where."""
    assert holds(check_equivariance(Between([0, 0], [0], bins), ["lemma 1", *EQ_2])) == 3 * [True]
    assert False in holds(check_equivariance(Between([0, 0], [0], bins, aside=4.0), EQ_2))


@pytest.mark.parametrize("frequency", [4, 6, 8])
def test_of_angles_that_tie_any_will_do(frequency: int) -> None:
    """One even frequency m: the best angle and those 360 / m degrees off it are the same grasp to the kernel."""
    assert holds(check_equivariance(Between([0, 0, 0], [frequency]), ["lemma 1", *EQ_2])) == 3 * [True]
    clockwise = Between([0, 0, 0], [frequency])
    clockwise.left = clockwise.left.mT
    assert False in holds(check_equivariance(clockwise, EQ_2))


def test_a_tie_that_comes_and_goes_is_none() -> None:
    """All angles tie wherever the target looks one way: before or after, but not both."""

    class Undecided(Between):
        def forward(self, embedding: Tensor) -> Tensor:
            kernel = super().forward(embedding).clone()
            kernel[:, 2] = 0  # the sine: half of what turns is not seen
            return kernel

    assert False in holds(check_equivariance(Undecided([0, 0], [0, 2]), EQ_2))


def test_a_score_that_forbids_hides_no_angle() -> None:
    """Beside -1e9 all angles are alike."""

    def forbid(scores: Tensor) -> Tensor:
        scores = scores.clone()
        scores[..., :2, :] = -1e9
        return scores

    def clockwise(synthesis: Tensor) -> Tensor:
        return synthesis.roll(1, 0).flip(0)

    law = LAWS["policy: eq. 2, any turn"]
    sound, broken = policy(scores=forbid), policy(scores=forbid, bins=clockwise)
    assert law.judge(sound, cases(law.turns, 4, 5)).passed
    assert not law.judge(broken, cases(law.turns, 4, 5)).passed


@pytest.mark.parametrize(("bins", "frequency"), [(3, 2), (5, 4), (7, 6)])
def test_bins_are_as_wide_as_they_are(bins: int, frequency: int) -> None:
    """A bin of 60 degrees is read to within a bin, and a turn by whole bins is one by its own."""
    laws = ["bins turn", *EQ_2]
    frequencies = list(range(0, frequency + 1, 2))
    assert holds(check_equivariance(Between([0, 0, 0], frequencies, bins), laws)) == 3 * [True]
    clockwise = Between([0, 0, 0], frequencies, bins)
    clockwise.left = clockwise.left.mT
    assert False in holds(check_equivariance(clockwise, laws))


class Rings(nn.Module):
    """A policy with nothing but its scores to show: no kappa, no reach."""

    embedding_size, stride = EMBEDDING, 2

    def __init__(self, change: Change = same, dtype: torch.dtype = torch.float64, phi: Change = same) -> None:
        super().__init__()
        self.formula = policy(change=change, dtype=dtype, phi=phi)
        self.louder = nn.Parameter(torch.ones(1, dtype=dtype))

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        return self.louder * self.formula.scores(observation, embedding)


ANY_TURN = ["policy: quarter turn", "policy: whole bins"]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_scores_of_a_policy_turn_at_turns_that_no_grid_has(dtype: torch.dtype) -> None:
    assert holds(check_equivariance(Rings(dtype=dtype), ANY_TURN)) == [True, True]
    for change in (sign_of(6), sign_of(8), uneven, square):
        assert holds(check_equivariance(Rings(change, dtype), ANY_TURN)) == [True, False]


def test_what_does_not_turn_by_quarters_is_asked_for_no_other_turn() -> None:
    report = check_equivariance(Rings(phi=lambda features: features.roll(1, 3)), ANY_TURN)
    assert [finding.status for finding in report.findings] == ["fails", "says nothing"]
    assert "scores of a cell being off at quarter turns about it as well" in str(report)


def test_what_says_that_its_scenes_turn_by_quarters_alone_is_taken_at_its_word() -> None:
    quarters = fields.gspaces.rot2dOnR2(4)

    class Quarters(Rings):
        in_type = fields.FieldType(quarters, 4 * [quarters.trivial_repr])

    report = check_equivariance(Quarters(uneven), ANY_TURN)
    assert [finding.status for finding in report.findings] == ["holds", "says nothing"]
    assert "its types are over C_4" in str(report)


@pytest.mark.parametrize("into", [[2], [1, 1], [0, 2], [3]])
def test_what_is_no_scalar_in_the_scene_turns_with_the_target(into: list[int]) -> None:
    laws = ["lemma 1", "equivariance", *EQ_2]
    assert holds(check_equivariance(Between(into, [0, 2, 4]), laws)) == 4 * [True]
    mistaken = holds(check_equivariance(Between(into, [0, 2, 4], sign=-1), laws))
    assert False in mistaken[2:]
