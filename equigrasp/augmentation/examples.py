"""A training's examples: drawn by the seed, the step and their place alone, and where they can be ahead of their step.

So neither the order in which they are drawn, nor a resume, nor how many processes share a step changes a bit of them.
Nothing here imports torch, which processes that only draw would wait seconds for.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import joblib
import numpy as np

from equigrasp.augmentation.augmentation import Augmentation, Example
from equigrasp.engines.in_order import in_order

Drawn = TypeVar("Drawn")

DRAWERS = 3
"""Processes that draw for a GPU: an example takes 1.5 to 4 ms of a core, and a step less."""


@dataclass(frozen=True)
class Draw:
    """Draws the examples of a step at these places of its batch.

    numpy's seeds end in zeros without end, so that the first one's is (seed, step).

    Attributes:
        augmentation: makes each example.
        seed: the training's.
        places: which of a step's examples.
    """

    augmentation: Augmentation
    seed: int
    places: range

    def __call__(self, step: int) -> list[Example]:
        """The step's examples."""
        return [self.augmentation.sample(np.random.default_rng([self.seed, step, place])) for place in self.places]


def in_turn(make: Callable[[int], Drawn], steps: Iterable[int]) -> Generator[Drawn, None, None]:
    """What `make` gives for each step, made when it is asked for: where a step has all cores, drawing would slow it."""
    for step in steps:
        yield make(step)


def ahead(make: Callable[[int], Drawn], steps: Iterable[int]) -> Generator[Drawn, None, None]:
    """What `make` gives for each step, in order, the next one made in a thread while this one is used.

    The thread ends with the generator: when it is used up or closed, or what `make` raised was raised here.
    """
    with ThreadPoolExecutor(1, "ahead") as pool:
        coming: Future[Drawn] | None = None
        try:
            for step in steps:
                following = pool.submit(make, step)
                if coming is not None:
                    yield coming.result()
                coming = following
            if coming is not None:
                yield coming.result()
        finally:
            pool.shutdown(cancel_futures=True)


def drawing(threads: int, device: str) -> Callable[[Callable[[int], Drawn], Iterable[int]], Generator[Drawn]]:
    """How examples are drawn for steps of so many threads, of all processes together.

    For a GPU in processes, because a step is shorter there than a draw, and because threads of Python draw one at a
    time. On a processor `ahead` where the steps leave a core to draw on, `in_turn` where they leave none.

    Args:
        threads: of the steps.
        device: "cpu" or "cuda"; where the steps run.
    """
    if device != "cpu":
        return functools.partial(in_order, workers=DRAWERS)
    return ahead if threads < joblib.cpu_count() else in_turn
