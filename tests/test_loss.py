"""The loss is torch's cross-entropy, value and gradient, for any scores that are numbers."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.nn import functional

from equigrasp.training.loss import loss_of


def drawn(seed: int, batch: int, spread: float, offset: float, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Scores of a small read-out, and a label for each scene."""
    generator = torch.Generator().manual_seed(seed)
    scores = torch.randn(batch, 4, 3, 5, generator=generator, dtype=torch.float64) * spread + offset
    return scores.to(dtype), torch.randint(60, (batch,), generator=generator)


def gradient(loss: Callable[[Tensor, Tensor], Tensor], scores: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
    """Three times the loss, so that its own gradient is not one; and the scores' gradient."""
    leaf = scores.clone().requires_grad_()
    value = 3 * loss(leaf, labels)
    value.backward()
    assert leaf.grad is not None
    return value.detach(), leaf.grad


def torchs_own(scores: Tensor, labels: Tensor) -> Tensor:
    return functional.cross_entropy(scores.flatten(1), labels)


def agrees(loss: Callable[[Tensor, Tensor], Tensor], scores: Tensor, labels: Tensor) -> bool:
    """Whether value and gradient are torch's own in float64, to the rounding of the scores' dtype."""
    tolerance = 50 * torch.finfo(scores.dtype).eps
    value, slope = gradient(loss, scores, labels)
    expected, expected_slope = gradient(torchs_own, scores.double(), labels)
    scale = max(1.0, float(scores.abs().max()))
    return bool(
        value.dtype == slope.dtype == scores.dtype
        and (value - expected).abs() <= tolerance * scale
        and (slope - expected_slope).abs().max() <= tolerance * scale
    )


@given(
    seed=st.integers(0, 2**32),
    batch=st.integers(1, 3),
    spread=st.sampled_from([0.0, 1e-3, 1.0, 30.0, 1e4]),
    offset=st.sampled_from([0.0, -1e3, 1e3]),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
def test_it_is_torchs_cross_entropy(seed: int, batch: int, spread: float, offset: float, dtype: torch.dtype) -> None:
    assert agrees(loss_of, *drawn(seed, batch, spread, offset, dtype))


@pytest.mark.parametrize(
    "broken",
    [
        lambda scores, labels: loss_of(scores, labels) * len(labels),
        lambda scores, labels: loss_of(scores, labels.roll(1)),
        lambda scores, labels: loss_of(scores.flip(1), labels),
        lambda scores, labels: loss_of(scores.detach(), labels) + 0 * scores.sum(),
    ],
    ids=["the sum of the batch", "another scene's label", "bins in another order", "no gradient"],
)
def test_a_broken_one_does_not_agree(broken: Callable[[Tensor, Tensor], Tensor]) -> None:
    assert not agrees(broken, *drawn(0, 3, 1.0, 0.0, torch.float64))


def test_scores_that_lie_in_another_order_have_the_same_loss() -> None:
    scores, labels = drawn(1, 2, 1.0, 0.0, torch.float64)
    assert agrees(loss_of, scores.contiguous(memory_format=torch.channels_last), labels)


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_what_is_no_number_shows_in_the_loss(number: float) -> None:
    scores, labels = drawn(2, 1, 1.0, 0.0, torch.float32)
    scores[0, 1, 2, 3] = number
    assert math.isnan(loss_of(scores, labels))


def test_a_cell_that_is_ruled_out_has_no_gradient() -> None:
    scores, labels = drawn(3, 1, 1.0, 0.0, torch.float64)
    ruled_out = (int(labels[0]) + 1) % 60
    scores.view(1, -1)[0, ruled_out] = -math.inf
    _, slope = gradient(loss_of, scores, labels)
    assert slope.flatten()[ruled_out] == 0
    assert slope.isfinite().all()


def test_the_same_loss_is_not_differentiated_twice() -> None:
    scores, labels = drawn(4, 1, 1.0, 0.0, torch.float64)
    loss = loss_of(scores.requires_grad_(), labels)
    loss.backward(retain_graph=True)
    with pytest.raises(RuntimeError, match="inplace"):
        loss.backward()
