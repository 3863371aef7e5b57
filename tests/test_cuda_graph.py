"""A training step takes nothing from the host, so that a GPU can replay it; what is replayed is what was done.

What needs a GPU is skipped where there is none.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

# read when torch first asks the GPU for a product
os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")

import pytest
import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

from equigrasp.bench.device import Timed, Uncaptured, measure, together
from equigrasp.encoder import unet
from equigrasp.models import MODELS, build
from equigrasp.plan import Training
from equigrasp.training.cuda_graph import EAGER, Captured
from equigrasp.training.devices import Process
from equigrasp.training.loss import loss_of
from equigrasp.training.step import State

GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU is here")
FROM_THE_HOST = {"tensor", "new_tensor", "as_tensor", "from_numpy", "to", "cpu", "cuda", "item", "tolist", "numpy"}
"""What makes a tensor of the host's numbers, moves one, or reads one's values."""


class Host(TorchFunctionMode):
    """Lists by name what moves numbers between the host and a device; `to` counts where it names a device."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[str] = []

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        name = getattr(func, "__name__", "")
        moves = name != "to" or "device" in kwargs or any(isinstance(each, (str, torch.device)) for each in args[1:])
        if name in FROM_THE_HOST and moves:
            self.asked.append(name)
        return func(*args, **kwargs)


def asked_by_a_step(name: str) -> list[str]:
    """What a model's fifth step asks of the host: what is made once for a size and a device is made before."""
    policy = build(replace(MODELS[name].untrained(), text_encoder="hashing", precision="float32"), seed=0).train()
    state = State(policy, Training(steps=5, seed=0))
    scene, embedding = torch.rand(1, 4, 32, 64), torch.ones(1, policy.embedding_size)
    label = torch.zeros(1, dtype=torch.long)
    host = Host()
    for step in range(EAGER + 2):
        with host if step > EAGER else torch.enable_grad():
            state.descend(loss_of(policy.logits(scene, embedding), label))
        state.follow()
    return host.asked


# the rotator's step of 36 turned copies is cliport-rn50's
@pytest.mark.parametrize("name", [name for name in MODELS if name != "cliport-rotator"])
def test_no_step_takes_anything_from_the_host(name: str) -> None:
    assert asked_by_a_step(name) == []


def test_a_step_that_brings_numbers_along_would_be_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def normalise(observation: Tensor) -> Tensor:
        return observation * observation.new_tensor([1 / 255, 1 / 255, 1 / 255, 10.0]).view(1, 4, 1, 1)

    monkeypatch.setattr(unet, "normalise", normalise)
    assert asked_by_a_step("leg-unet") == ["new_tensor"]


def test_on_a_processor_work_is_done_as_it_is() -> None:
    assert Process(torch.device("cpu")).captured(loss_of) is loss_of


def weights_after(process: Process, name: str, steps: int) -> dict[str, Tensor]:
    """The weights and their average after steps on noise that differs from step to step."""
    policy = build(replace(MODELS[name], text_encoder="hashing"), seed=0).to(process.device).train()
    state = State(policy, Training(steps=steps, seed=0))
    generator = torch.Generator().manual_seed(0)

    def descend(observations: Tensor, language: Tensor, labels: Tensor) -> Tensor:
        loss = loss_of(policy.logits(observations, language), labels)
        state.descend(loss)
        return loss.detach()

    step = process.captured(descend)
    losses = []
    for _ in range(steps):
        scene = torch.rand(1, 4, 64, 96, generator=generator)
        language = torch.nn.functional.normalize(torch.randn(1, policy.embedding_size, generator=generator))
        labels = torch.randint(36 * 32 * 48, (1,), generator=generator)
        losses.append(step(*process.take(scene, language, labels)))
        state.follow()
    return {**state.tensors(), "losses": torch.stack(losses)}


@pytest.fixture
def in_one_order() -> Iterator[None]:
    """By itself a GPU adds the gradients of a resize and of an attention in no fixed order."""
    torch.use_deterministic_algorithms(True, warn_only=True)
    yield
    torch.use_deterministic_algorithms(False)


@GPU
@pytest.mark.parametrize("name", ["leg-unet", "leg-steerable", "leg-equivariant", "fcgq", "vit"])
def test_a_replayed_training_is_the_one_that_was_asked_for_step_by_step(name: str, in_one_order: None) -> None:
    device = torch.device("cuda")
    replayed, asked = (weights_after(kind(device), name, steps=EAGER + 9) for kind in (Process, Uncaptured))
    for key in asked:
        assert torch.equal(replayed[key], asked[key]), key


@GPU
def test_a_result_is_not_overwritten_by_the_next_replay() -> None:
    double: Callable[..., Tensor] = Captured(lambda each: 2 * each)
    results = [double(torch.full((3,), float(value), device="cuda")) for value in range(EAGER + 4)]
    assert [float(each[0]) for each in results] == [2.0 * value for value in range(EAGER + 4)]


@GPU
def test_steps_are_timed_as_a_graph_and_side_by_side() -> None:
    timed = Timed("leg-steerable", batch=1, captured=True, precision="auto", steps=5)
    assert measure(torch.device("cuda"), timed)["host"] > 0
    assert together(torch.device("cuda"), timed, 2)["side_by_side"] == 2
