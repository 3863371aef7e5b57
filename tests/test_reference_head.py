"""Our head is the paper's, step by step: scores and gradients, for n = 36 and 72."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from equigrasp import models
from equigrasp.correlation import correlate
from equigrasp.errors import InputError
from equigrasp.kernel import LiftedKernel
from equigrasp.reference_head import LiteralHead, LiteralPolicy, correlate_directly

TOLERANCE = 1e-11
"""Of the largest value, float64: the two do the same sums in another order."""


def kernel(group_order: int, exact: bool = True) -> LiftedKernel:
    torch.manual_seed(0)
    return LiftedKernel(12, 3, 9, 8, group_order, exact, widths=(8, 8, 8)).double()


def problem() -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(1)
    features = torch.randn(2, 3, 14, 22, generator=generator, dtype=torch.float64)
    embedding = torch.nn.functional.normalize(torch.randn(2, 12, generator=generator, dtype=torch.float64))
    return features, embedding


def answers(head: Callable[[Tensor, Tensor], Tensor], weights: Sequence[Tensor]) -> list[Tensor]:
    """What a head gives, and the gradients by the features, the embedding and the weights of a fixed functional."""
    features, embedding = (each.requires_grad_() for each in problem())
    field = head(features, embedding)
    functional = torch.randn(field.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return [field.detach(), *torch.autograd.grad((field * functional).sum(), [features, embedding, *weights])]


def furthest(ours: list[Tensor], theirs: list[Tensor]) -> float:
    """The largest difference, relative to the largest value of each tensor."""
    return max(float((a - b).abs().max() / b.abs().max()) for a, b in zip(ours, theirs, strict=True))


@pytest.mark.parametrize("correlation", [correlate, correlate_directly])
@pytest.mark.parametrize(("group_order", "exact"), [(36, True), (72, True), (90, False)])
def test_the_transform_may_come_before_the_correlation(
    group_order: int, exact: bool, correlation: Callable[[Tensor, Tensor], Tensor]
) -> None:
    kappa = kernel(group_order, exact)
    weights = list(kappa.psi.parameters())
    ours = answers(lambda features, embedding: correlate(features, kappa(embedding)), weights)
    assert len(ours) > 8
    assert furthest(ours, answers(LiteralHead(kappa, group_order, correlation).double(), weights)) < TOLERANCE


@pytest.mark.parametrize("broken", ["turns the other way", "a sine too strong", "no disc", "another group"])
def test_another_reading_would_be_noticed(broken: str) -> None:
    kappa = kernel(36)
    weights = list(kappa.psi.parameters())
    head = LiteralHead(kappa, 72 if broken == "another group" else 36).double()
    if broken == "turns the other way":
        head.turns.value = head.turns.value.roll(-1, 0).flip(0)
    elif broken == "a sine too strong":
        head.fourier.value[2] *= 1.01
    elif broken == "no disc":
        head.disc.value = torch.ones_like(head.disc.value)
    ours = answers(lambda features, embedding: correlate(features, kappa(embedding)), weights)
    assert furthest(ours, answers(head, weights)) > 1e-4


@pytest.mark.parametrize("group_order", [36, 72])
def test_a_whole_policy_scores_the_same(group_order: int) -> None:
    row = replace(
        models.MODELS["leg-unet"],
        kernel_size=9,
        group_order=group_order,
        channels=3,
        widths=(8,) * 5,
        precision="float32",
        text_encoder="hashing",
    )
    policy = models.build(row, seed=0).double()
    literal = LiteralPolicy(policy, group_order).double()
    generator = torch.Generator().manual_seed(3)
    observation = torch.rand(1, 4, 64, 96, generator=generator, dtype=torch.float64) * 255
    embedding = torch.nn.functional.normalize(torch.randn(1, 512, generator=generator, dtype=torch.float64))
    with torch.no_grad():
        ours, theirs = policy(observation, embedding), literal(observation, embedding)
    assert theirs.shape == (1, 36, 32, 48)
    assert furthest([ours], [theirs]) < TOLERANCE


def test_what_has_no_literal_reading_is_refused() -> None:
    with pytest.raises(InputError, match="see leg-unet"):
        LiteralPolicy(models.build(replace(models.MODELS["leg-steerable"], kernel_size=17, maximum_frequency=4)), 72)
    with pytest.raises(InputError, match="C_16 does not carry frequency 8"):
        LiteralHead(kernel(36), 16)
