"""Kernels to compare with: the exact basis, the paper's lift over C_72 and C_90, and one with no steerability."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.kernel import LiftedKernel, SteerableKernel
from equivariance_tests.law import Case, cases
from equivariance_tests.laws import LAWS
from equivariance_tests.subjects import KernelSubject
from equivariance_tests.wrapping import kernel_subject

EMBEDDING, CHANNELS, SIZE, FREQUENCY = 16, 3, 33, 16
ANGLES = tuple(range(0, 181, 5))
"""Degrees; even frequencies make the second half turn a copy of the first."""


class FreeKernel(nn.Module):
    """Every tap is free: what a fully convolutional network with an output for each angle correlates with."""

    embedding_size = EMBEDDING

    def __init__(self) -> None:
        super().__init__()
        self.in_type, self.out_type = fields.trivial_type(CHANNELS), fields.even_type(FREQUENCY)
        self.taps = nn.Linear(EMBEDDING, self.out_type.size * CHANNELS * SIZE**2)

    def forward(self, embedding: Tensor) -> Tensor:
        """`(B, D)` -> `(B, O, C, k, k)`."""
        return self.taps(embedding).view(-1, self.out_type.size, CHANNELS, SIZE, SIZE)


COMPARISON: dict[str, Callable[[], nn.Module]] = {
    "exact basis": lambda: SteerableKernel(EMBEDDING, CHANNELS, SIZE, FREQUENCY),
    "lift, C_72": lambda: LiftedKernel(EMBEDDING, CHANNELS, SIZE, FREQUENCY),
    "lift, C_90 (the paper's)": lambda: LiftedKernel(
        EMBEDDING, CHANNELS, SIZE, FREQUENCY, group_order=90, exact_quarter_turns=False
    ),
    "free taps (plain FCN)": FreeKernel,
}


def comparison(seed: int = 0) -> dict[str, KernelSubject]:
    """One subject for each, with fresh random weights; torch's own generator stays as it was."""
    subjects = {}
    for name, make in COMPARISON.items():
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            subjects[name] = kernel_subject(make(), EMBEDDING)
    return subjects


def error_against_angle(
    subjects: Mapping[str, KernelSubject],
    draws: int = 4,
    progress: Callable[[Any], Iterable[Any]] = iter,
) -> dict[str, list[float]]:
    """The largest violation of Eq. 7 at each of ANGLES, over `draws` random kernels and scenes; NaN where g is none."""
    law = LAWS["steerability"]

    def worst(subject: KernelSubject, degrees: int) -> float:
        found = [law.measure(subject, Case(float(degrees), seed=seed)) for seed in range(draws)]
        return max((each.value for each in found if each is not None), default=math.nan)

    return {name: [worst(subject, degrees) for degrees in ANGLES] for name, subject in progress(list(subjects.items()))}


def errors_of_eq_2(
    subjects: Mapping[str, KernelSubject],
    scenes: int = 50,
    seed: int = 0,
    progress: Callable[[Any], Iterable[Any]] = iter,
) -> dict[str, dict[str, list[float]]]:
    """How far the best grasp lands from where g takes it, in cells or bins: name -> law -> one error a scene.

    Turns are those that a subject has; scenes in which nothing can be measured are left out.
    """
    laws = ("eq. 2, whole bins", "eq. 2, any turn")
    found: dict[str, dict[str, list[float]]] = {}
    for name, subject in progress(list(subjects.items())):
        found[name] = {}
        for law in (LAWS[each] for each in laws):
            asked = (law.admitted(subject, case) for case in cases(law.turns, scenes, seed))
            measured = (law.measure(subject, case) for case in asked)
            found[name][law.name] = [each.value for each in measured if each is not None]
    return found
