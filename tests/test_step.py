"""Adam's step and the moving average of the weights: what it follows, how fast, and that it is what is saved."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load, load_file, save
from small import SMALL

from equigrasp.grasp import Demonstration
from equigrasp.models import build
from equigrasp.plan import WEIGHTS, Training
from equigrasp.policy import LegPolicy
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


class InOddMemory(torch.nn.Module):
    """Weights that lie in memory in all the ways in which those of a module of one's own may."""

    def __init__(self) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(0)

        def drawn(*shape: int) -> torch.Tensor:
            return torch.randn(shape, generator=generator)

        self.plain = torch.nn.Parameter(drawn(6, 4))
        self.scalar = torch.nn.Parameter(drawn())
        self.turned = torch.nn.Parameter(drawn(6, 4).t())
        self.channels_last = torch.nn.Parameter(drawn(4, 8, 3, 3).contiguous(memory_format=torch.channels_last))
        self.pixels_first = torch.nn.Parameter(drawn(3, 3, 4, 8).permute(2, 3, 0, 1))
        self.with_gaps = torch.nn.Parameter(drawn(6, 8)[:, ::2])
        self.without_gradient = torch.nn.Parameter(drawn(3))

    def forward(self, step: int) -> torch.Tensor:
        """A loss of which every element has a gradient of its own, another at each step."""
        weights = (self.plain, self.scalar, self.turned, self.channels_last, self.pixels_first, self.with_gaps)
        flat = torch.cat([weight.flatten() for weight in weights])
        return (flat * torch.arange(step, step + len(flat)).cos()).square().sum()


def in_odd_memory() -> LegPolicy:
    """A policy with such weights besides its own, which have no gradient."""
    policy = build(SMALL, seed=0)
    assert isinstance(policy, LegPolicy)
    policy.phi.odd = InOddMemory()
    return policy


def stepped(state: State, steps: range) -> State:
    for step in steps:
        state.update(state.policy.get_submodule("phi.odd")(step))
    return state


def test_adam_is_adam_in_whatever_order_a_weight_lies_in_memory() -> None:
    """torch's fused Adam walks memory, and says nothing where that of a gradient is another than its weight's."""
    state = stepped(State(in_odd_memory(), Training(steps=6, seed=0, learning_rate=1e-2)), range(6))
    textbook = InOddMemory().double()
    adam = torch.optim.Adam(textbook.parameters(), lr=1e-2, foreach=False)
    for step in range(6):
        adam.zero_grad()
        textbook(step).backward()
        adam.step()
    weights, tensors = dict(textbook.named_parameters()), state.tensors()
    for name, weight in weights.items():
        ours = tensors[f"weights.phi.odd.{name}"]
        torch.testing.assert_close(ours.double(), weight.detach(), rtol=0, atol=1e-5)
        for key in ("exp_avg", "exp_avg_sq") if weight.grad is not None else ():
            moment = tensors[f"adam.{key}.phi.odd.{name}"]
            torch.testing.assert_close(moment.double(), adam.state[weight][key], rtol=1e-4, atol=1e-6)
    assert not any("without_gradient" in name for name in tensors if name.startswith("adam."))


def test_steps_go_on_from_what_was_kept_in_whatever_order_a_weight_lies() -> None:
    training = Training(steps=6, seed=0, learning_rate=1e-2)
    through = stepped(State(in_odd_memory(), training), range(6)).tensors()
    first = stepped(State(in_odd_memory(), training), range(3))
    second = State(in_odd_memory(), training)
    second.restore(load(save({name: value.contiguous() for name, value in first.tensors().items()})))
    resumed = stepped(second, range(3, 6)).tensors()
    assert resumed.keys() == through.keys()
    assert all(torch.equal(value, resumed[name]) for name, value in through.items())


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


def test_a_step_does_not_wait_for_torchs_compiler() -> None:
    """torch's own class of optimisers imports it, which takes longer than torch itself."""
    code = """
import sys, torch
from equigrasp.training.adam import Adam
weight = torch.nn.Parameter(torch.ones(3))
weight.sum().backward()
Adam({"weight": weight}, learning_rate=0.5).step()
print((weight < 1).all().item(), "torch._dynamo" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True False"
