"""What acting keeps is its policy's own: a copy starts without it, and threads that share it never take another's."""

from __future__ import annotations

import copy
import pickle
import sys
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import cloudpickle
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from equigrasp import Observation, kept, models
from equigrasp.kept import Kept

INSTRUCTIONS = [f"pick up thing number {number}" for number in range(24)]


def scene() -> Observation:
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (32, 64, 3), dtype=np.uint8)
    return Observation(color, rng.uniform(0, 0.1, (32, 64)).astype(np.float32))


def heard(keeper: Kept, number: int, module: nn.Module, made: list[int]) -> Tensor:
    """The embedding of an instruction, which is its number; `made` grows where it is made anew."""

    def make() -> Tensor:
        made.append(number)
        return torch.tensor([float(number)])

    return keeper.embedding((str(number),), module, "settings", make)


# Copies

COPIES = [copy.copy, copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))]


@pytest.mark.parametrize("again", COPIES, ids=["copy", "deepcopy", "pickle"])
def test_a_copy_keeps_nothing(again: Callable[[Kept], Kept]) -> None:
    module, keeper, made = nn.Linear(1, 1), Kept(), []
    for number in range(3):
        keeper.kernel(heard(keeper, number, module, made), lambda each: -each)
    other = again(keeper)
    for number in range(3):
        assert other.kernel(heard(other, number, module, made), lambda each: -2 * each) == -2 * number
        assert keeper.kernel(heard(keeper, number, module, made), lambda each: -3 * each) == -number
    assert made == [0, 1, 2, 0, 1, 2]


def test_a_pickled_policy_acts_as_before_and_carries_no_kernels() -> None:
    policy = models.build(replace(models.MODELS["leg-steerable"], text_encoder="hashing", precision="float32")).eval()
    empty = len(cloudpickle.dumps(policy))
    expected = [policy.act(scene(), words) for words in INSTRUCTIONS]
    content = cloudpickle.dumps(policy)
    del policy
    assert len(content) == empty
    loaded = pickle.loads(content)
    for _ in range(2):  # the second time with what was kept
        assert [loaded.act(scene(), words) for words in INSTRUCTIONS] == expected


# Buffers


def test_what_was_made_with_other_buffers_is_made_anew() -> None:
    """A batch norm in training moves its buffers and no parameter."""
    module, keeper, made = nn.BatchNorm1d(1), Kept(), []
    for _ in range(2):
        assert keeper.kernel(heard(keeper, 1, module, made), lambda each: -each) == -1
    assert made == [1]
    module(torch.tensor([[1.0], [2.0]]))
    assert keeper.kernel(heard(keeper, 1, module, made), lambda each: -2 * each) == -2
    assert made == [1, 1]


# Threads


@pytest.fixture
def hasty() -> Generator[None]:
    """Threads that take turns a hundred times as often."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(5e-5)
    yield
    sys.setswitchinterval(before)


def test_threads_that_forget_each_others_instructions_take_no_others_kernel(
    hasty: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "MOST", 4)
    module, keeper, end = nn.Linear(1, 1), Kept(), time.monotonic() + 2

    def ask(seed: int) -> tuple[int, int]:
        rng, asked, wrong = np.random.default_rng(seed), 0, 0
        while time.monotonic() < end:
            number = int(rng.integers(1, 12))
            wrong += keeper.kernel(heard(keeper, number, module, []), lambda each: -each).item() != -number
            asked += 1
        return asked, wrong

    with ThreadPoolExecutor(4) as pool:
        asked, wrong = np.sum(list(pool.map(ask, range(4))), axis=0)
    assert asked > 100
    assert wrong == 0


def test_a_kernel_that_was_forgotten_while_it_was_made_is_nobodys() -> None:
    module, keeper = nn.Linear(1, 1), Kept()
    inside, go_on = threading.Event(), threading.Event()

    def slowly(embedding: Tensor) -> Tensor:
        inside.set()
        assert go_on.wait(30)
        return embedding + 1000

    def ask() -> Tensor:
        return keeper.kernel(heard(keeper, 1, module, []), slowly)

    with ThreadPoolExecutor(1) as pool:
        late = pool.submit(ask)
        assert inside.wait(30)
        keeper.clear()
        go_on.set()
        assert late.result() == 1001
    # one of so many has the address of the forgotten one
    for number in range(2, 400):
        assert keeper.kernel(heard(keeper, number, module, []), lambda each: -each) == -number


def test_kernels_of_two_instructions_are_made_at_once() -> None:
    module, keeper, together = nn.Linear(1, 1), Kept(), threading.Barrier(2)

    def make(embedding: Tensor) -> Tensor:
        together.wait(30)
        return -embedding

    def ask(number: int) -> Any:
        return keeper.kernel(heard(keeper, number, module, []), make).item()

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(ask, [1, 2])) == [-1, -2]
