"""A training's examples: drawn by the seed, the step and their place alone, ahead of their step, and made a batch.

So neither the order in which they are drawn, nor a resume, nor how many processes share a step changes a bit of them.
"""

from __future__ import annotations

import functools
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from equigrasp.augmentation import Augmentation, Example
from equigrasp.policy import GraspPolicy, to_tensor
from equigrasp.workspace import WORKSPACE

Drawn = TypeVar("Drawn")


def draw(augmentation: Augmentation, seed: int, step: int, places: Iterable[int]) -> list[Example]:
    """The examples of a step at these places of its batch.

    numpy's seeds end in zeros without end, so that the first one's is (seed, step).
    """
    return [augmentation.sample(np.random.default_rng([seed, step, place])) for place in places]


def in_turn(make: Callable[[int], Drawn], steps: Iterable[int]) -> Generator[Drawn, None, None]:
    """What `make` gives for each step, made when it is asked for: where a step has all cores, drawing would slow it."""
    for step in steps:
        yield make(step)


def ahead(make: Callable[[int], Drawn], steps: Iterable[int], threads: int = 1) -> Generator[Drawn, None, None]:
    """What `make` gives for each step, in order, the next ones made in as many threads while this one is used.

    The threads end with the generator: when it is used up or closed, or what `make` raised was raised here.
    """
    with ThreadPoolExecutor(threads, "ahead") as pool:
        coming: deque[Future[Drawn]] = deque()
        try:
            for step in steps:
                coming.append(pool.submit(make, step))
                if len(coming) > threads:
                    yield coming.popleft().result()
            while coming:
                yield coming.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


def drawing(threads: int, device: torch.device) -> Callable[[Callable[[int], Drawn], Iterable[int]], Generator[Drawn]]:
    """How examples are drawn for steps of so many threads, of all processes together.

    `ahead` where they leave a core to draw on, by two threads for a GPU, whose step is shorter than a draw; `in_turn`
    where they leave none.
    """
    if device.type != "cpu":
        return functools.partial(ahead, threads=2)
    return ahead if threads < (os.cpu_count() or 1) else in_turn


def collate(
    policy: GraspPolicy, examples: Sequence[Example], embeddings: Mapping[str, Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """Examples as a batch: observations `(B, 4, H, W)`, embeddings `(B, D)`, labels `(B,)` into the read-out."""
    read_out = policy.read_out(WORKSPACE.shape)
    return (
        torch.stack([to_tensor(each.observation) for each in examples]),
        torch.stack([embeddings[each.instruction] for each in examples]),
        torch.tensor([read_out.label(each.grasp) for each in examples]),
    )
