"""The moving average of the weights: what it follows, how fast, and that it is what is saved."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from small import SMALL

from equigrasp.grasp import Demonstration
from equigrasp.models import build
from equigrasp.plan import WEIGHTS, Training
from equigrasp.training import CHECKPOINT, train
from equigrasp.training.step import State


@pytest.mark.parametrize("slowest", [0.5, 0.998])
def test_the_average_follows_the_weights_ever_more_slowly(slowest: float) -> None:
    """Of 0.998 it warms up over all these steps, of 0.5 it is as slow as it gets from the eighth on."""
    state = State(build(SMALL, seed=0), Training(steps=1, seed=0, average=slowest))
    expected = {name: value.double() for name, value in state.average.items()}
    generator = torch.Generator().manual_seed(0)
    for step in range(1, 21):
        decay = min(slowest, (1 + step) / (10 + step))
        with torch.no_grad():
            for name, weight in state.parameters.items():
                weight.copy_(torch.randn(weight.shape, generator=generator))
                expected[name] = decay * expected[name] + (1 - decay) * weight.double()
        state.follow()
        assert state.step == step
        for name, value in state.average.items():
            torch.testing.assert_close(value.double(), expected[name], rtol=0, atol=1e-5)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_training_begins_with_its_seeds_weights_and_saves_their_average(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration], seed: int
) -> None:
    run = tmp_path / "run"
    train(SMALL, Training(steps=3, seed=seed, threads=1, learning_rate=1e-7), demonstrations, data, run)
    kept, saved = load_file(run / CHECKPOINT), load_file(run / WEIGHTS)
    first, other = (build(SMALL, each).state_dict() for each in (seed, 1 - seed))
    for name, value in saved.items():
        assert torch.equal(value, kept[f"average.{name}"])
        # three steps of Adam change a weight by no more than three times the rate
        torch.testing.assert_close(value, first[name], rtol=0, atol=1e-6)
    assert any(not torch.equal(value, kept[f"weights.{name}"]) for name, value in saved.items())
    assert any(not torch.allclose(first[name], other[name], rtol=0, atol=1e-3) for name in saved)
