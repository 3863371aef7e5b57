"""Modules that fool a check which looks too little, and sound ones that a check which looks askew calls broken."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.correlation import correlate
from equigrasp.errors import InputError
from equivariance_tests import LAWS, check_equivariance
from equivariance_tests.check import Report
from equivariance_tests.grasp_laws import smooth_quarter_turn
from equivariance_tests.law import cases
from equivariance_tests.mutants import darker, edges
from equivariance_tests.sound import EMBEDDING, kernel, policy

QUARTER, ANY_TURN = "policy: quarter turn", "policy: eq. 2, any turn"
FORMULA = kernel(size=25, radii=(5.0, 6.5, 8.0))
ONE = kernel(channels=4, size=25, radii=(5.0, 6.5, 8.0), frequencies=(0,))
TWO = kernel(channels=4, size=25, radii=(5.0, 6.5, 8.0), frequencies=(0, 2))
TABLE = torch.tensor([90.0, 90.0, 90.0, 0.0], dtype=torch.float64).view(4, 1, 1)
UNIT = torch.tensor([40.0, 40.0, 40.0, 0.02], dtype=torch.float64).view(4, 1, 1)


class Ours(nn.Module):
    """The sound policy as a module."""

    embedding_size = EMBEDDING

    def __init__(self, dtype: torch.dtype = torch.float32) -> None:
        super().__init__()
        self.formula = policy(dtype=dtype)
        self.louder = nn.Parameter(torch.ones(1, dtype=dtype))

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 4, H, W)`, `(B, 8)` -> `(B, 36, H / 2, W / 2)`."""
        return self.louder * self.formula.scores(observation, embedding)


class Kernel(nn.Module):
    """The sound kernel as a module."""

    embedding_size, in_type, out_type = EMBEDDING, FORMULA.in_type, FORMULA.out_type

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("read_out", fields.synthesis(8))

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, 8)` -> `(B, 9, 3, 25, 25)`."""
        return FORMULA.generate(embedding.double())


def cell_means(observation: Tensor, cell: int = 2) -> Tensor:
    return functional.avg_pool2d((observation.double() - TABLE) / UNIT, cell)


def statuses(report: Report) -> list[str]:
    return [finding.status for finding in report.findings]


@pytest.mark.parametrize("phi", [edges, darker])
def test_a_rough_scene_shows_what_no_smooth_one_does(phi: Callable[[Tensor], Tensor]) -> None:
    law, subject = LAWS[QUARTER], policy(phi=phi)
    for case in cases(law.turns, 4):
        smooth, both = smooth_quarter_turn(subject, case), law.measure(subject, case)
        assert smooth is not None
        assert both is not None
        assert smooth.value < 1e-3 < 0.05 < both.value
        assert "of a rough scene" in both.message


class OneBin(Ours):
    """How well it could be grasped anyhow, as by suction."""

    def __init__(self, blur: float) -> None:
        super().__init__()
        self.blur = blur

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 1, H / 2, W / 2)`."""
        features = cell_means(observation)
        features = features + self.blur * (features.roll(1, 3) + features.roll(-1, 3))
        return self.louder * correlate(features, ONE.generate(embedding.double())).float()


def test_of_one_bin_quarter_turns_are_asked_too() -> None:
    assert statuses(check_equivariance(OneBin(0.0), [QUARTER])) == ["holds"]
    assert statuses(check_equivariance(OneBin(0.5), [QUARTER])) == ["fails"]


class ThreeBins(Ours):
    """Bins of 60 degrees, on a grid of cells of four pixels."""

    def __init__(self, sign: int) -> None:
        super().__init__()
        theta = torch.arange(3, dtype=torch.float64) * math.pi / 3
        waves = [torch.ones_like(theta), torch.cos(2 * theta), sign * torch.sin(2 * theta)]
        self.register_buffer("matrix", torch.stack(waves, dim=1))

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 3, H / 2, W / 2)`."""
        features = functional.interpolate(cell_means(observation, 4), scale_factor=2)
        field = correlate(features, TWO.generate(embedding.double()))
        return self.louder * torch.einsum("io,bohw->bihw", self.get_buffer("matrix"), field).float()


def test_of_three_bins_an_angle_can_be_wrong() -> None:
    assert statuses(check_equivariance(ThreeBins(1), [ANY_TURN])) == ["holds"]
    assert statuses(check_equivariance(ThreeBins(-1), [ANY_TURN])) == ["fails"]


class Scrambled(Kernel):
    """A permute forgotten: the kernel of one instruction, and of two instructions no kernel at all."""

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, 8)` -> `(B, 9, 3, 25, 25)`."""
        taps = super().forward(embedding)
        return taps.transpose(0, 1).reshape(taps.shape)


class FirstOnly(Ours):
    """Right for the first scene of a batch."""

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 36, H / 2, W / 2)`."""
        scores = super().forward(observation, embedding)
        return torch.cat([scores[:1], scores[1:].flip(2)])


class Together(Ours):
    """Fainter, the more there is in the whole batch."""

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 36, H / 2, W / 2)`."""
        return super().forward(observation, embedding) / observation.std()


@pytest.mark.parametrize("module", [Scrambled(), FirstOnly(), Together()], ids=lambda each: type(each).__name__)
def test_what_one_input_makes_of_another_is_refused(module: nn.Module) -> None:
    with pytest.raises(InputError, match="for two inputs in one batch than for each alone"):
        check_equivariance(module)


def test_a_kernel_for_one_instruction_at_a_time_is_measured() -> None:
    class One(Kernel):
        def forward(self, embedding: Tensor) -> Tensor:
            """`(1, 8)` -> `(1, 9, 3, 25, 25)`."""
            return super().forward(embedding.view(1, -1))

    assert statuses(check_equivariance(One(), ["lemma 1"])) == ["holds"]


class Coarse(Ours):
    """Weights of float64, scores of float32."""

    def __init__(self) -> None:
        super().__init__(torch.float64)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 36, H / 2, W / 2)` float32."""
        return super().forward(observation, embedding).float() + 1000


def test_scores_of_float32_are_held_to_its_tolerance() -> None:
    (finding,) = check_equivariance(Coarse(), [QUARTER]).findings
    assert finding.verdict is not None
    assert finding.verdict.passed, finding.verdict
    assert finding.verdict.tolerance == LAWS[QUARTER].tolerance[torch.float32]


class Taps(nn.Module):
    """Random taps and their quarter turn, exact over C_4: as small as kernels get."""

    embedding_size = EMBEDDING

    def __init__(self, size: int) -> None:
        super().__init__()
        space = fields.gspaces.rot2dOnR2(4)
        self.in_type = fields.FieldType(space, 3 * [space.trivial_repr])
        self.out_type = fields.FieldType(space, [space.quotient_repr(2)])
        taps = torch.randn(3, size, size, generator=torch.Generator().manual_seed(0))
        taps = taps + taps.rot90(2, (1, 2))
        self.register_buffer("taps", torch.stack([taps, taps.rot90(1, (1, 2))]))
        self.register_buffer("read_out", torch.eye(2))

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, 8)` -> `(B, 2, 3, k, k)`."""
        return (3 + embedding.sum(dim=1)).view(-1, 1, 1, 1, 1) * self.get_buffer("taps")


@pytest.mark.parametrize("size", [1, 3])
def test_a_kernel_of_a_few_taps_is_sound(size: int) -> None:
    report = check_equivariance(Taps(size), ["lemma 1", "translation", "eq. 2, whole bins", "eq. 2, any turn"])
    assert report.passed, report


class ById(Ours):
    """Keeps what it made of a tensor by where that lies: another one may come to lie there."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: dict[int, Tensor] = {}

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 36, H / 2, W / 2)` of some observation."""
        first = len(self.kept) < 1
        return self.kept.setdefault(0 if not first else len(self.kept), super().forward(observation, embedding))


def test_an_answer_of_another_shape_is_one_sentence() -> None:
    with pytest.raises(InputError, match=r"makes scores \(1, 36, 32, 64\) of a scene of 128 x 128 pixels"):
        check_equivariance(ById(), [QUARTER])


def test_too_few_bins_for_a_type_fail_fourier_and_crash_nothing() -> None:
    class Aliased(Kernel):
        def __init__(self) -> None:
            super().__init__()
            theta = torch.arange(6, dtype=torch.float64) * math.pi / 6
            waves = [wave(m * theta) for m in (2, 4, 6, 8) for wave in (torch.cos, torch.sin)]
            self.read_out = torch.stack([torch.ones_like(theta), *waves], dim=1)

    (finding,) = check_equivariance(Aliased(), ["fourier"]).findings
    assert finding.verdict is not None
    assert "6 bins carry no frequency 8" in finding.verdict.message


@pytest.mark.parametrize("declared", [{"reach": 1e6}, {"reach": np.int64(25)}, {"embedding_size": np.int64(EMBEDDING)}])
def test_numbers_of_numpy_and_a_reach_beyond_all_tables_are_taken(declared: dict[str, Any]) -> None:
    module = Ours()
    for name, value in declared.items():
        setattr(module, name, value)
    assert statuses(check_equivariance(module, ["policy: whole bins"])) == ["holds"]
