"""A training's examples: drawn by the seed, the step and their place alone, and where they can be ahead of their step.

So neither the order in which they are drawn, nor a resume, nor how many processes share a step changes a bit of them.
For a processor they are painted where they are drawn; for a GPU, which has what was cut out, they are told in numbers.
Nothing here imports torch, which processes that only draw would wait seconds for.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Generic, TypeVar

import joblib
import numpy as np
from numpy.typing import NDArray

from equigrasp.augmentation.augmentation import Augmentation, Example
from equigrasp.augmentation.layout import Moved
from equigrasp.augmentation.repainting import Painted
from equigrasp.engines.in_order import in_order
from equigrasp.grasp import Grasp
from equigrasp.workspace import backward

Drawn = TypeVar("Drawn")

DRAWERS = 3
"""Processes that draw for a GPU: ahead of its steps, of whatever batch, and of a study's other trainings beside."""


@dataclass(frozen=True, eq=False)
class Recipe:
    """An example in numbers, for whoever has the pixels: `equigrasp.training.painter`.

    Attributes:
        numbers: `(N,)` int64, which objects: as cutouts are numbered, and after them the demonstrations as a whole.
        ways: `(N, 2, 3)` float32, from (u, v, 1) of the heightmap to (u, v) of the object, in coordinates from the
            first pixel's corner; of those that there are none of, to beside it.
        paints: `(N, 3)` float32, the paint that each is put down in; not a number for its own.
        ground: whose table and level: as scenes are numbered, and after them the demonstrations.
        instruction: as of an `Example`.
        grasp: as of an `Example`.
    """

    numbers: NDArray[np.int64]
    ways: NDArray[np.float32]
    paints: NDArray[np.float32]
    ground: int
    instruction: str
    grasp: Grasp


def painted(augmentation: Augmentation, rng: np.random.Generator) -> Example:
    """An example with its pixels."""
    return augmentation.sample(rng)


def recipe(augmentation: Augmentation, rng: np.random.Generator) -> Recipe:
    """The same example in numbers, of as many objects as any of the augmentation's may have."""
    sketch, scenes = augmentation.sketch(rng), augmentation.scenes
    layout = sketch.layout
    numbers = np.zeros(augmentation.most, dtype=np.int64)
    ways = np.zeros((augmentation.most, 2, 3), dtype=np.float32)
    ways[:, 0, 2] = -1.0
    paints = np.full((augmentation.most, 3), np.nan, dtype=np.float32)
    if isinstance(layout, Moved):
        numbers[0] = sum(1 + len(each.others) for each in scenes) + layout.number
        ways[0] = backward(augmentation.workspace.pixel_map(layout.motion))
        ground = len(scenes) + layout.number
    else:
        for place, each in enumerate(layout.placements):
            numbers[place], ways[place] = each.cutout.number, backward(each.pixel_map)
            if isinstance(each.cutout, Painted):
                paints[place] = each.cutout.paint
        ground = layout.number
    return Recipe(numbers, ways, paints, ground, sketch.instruction, sketch.grasp)


@dataclass(frozen=True)
class Draw(Generic[Drawn]):
    """Draws the examples of a step at these places of its batch.

    numpy's seeds end in zeros without end, so that the first one's is (seed, step).

    Attributes:
        augmentation: makes each example.
        seed: the training's.
        places: which of a step's examples.
        make: what is made of an example: `painted` or `recipe`.
    """

    augmentation: Augmentation
    seed: int
    places: range
    make: Callable[[Augmentation, np.random.Generator], Drawn]

    def __call__(self, step: int) -> list[Drawn]:
        """The step's examples."""
        generators = (np.random.default_rng([self.seed, step, place]) for place in self.places)
        return [self.make(self.augmentation, rng) for rng in generators]


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

    For a GPU in processes, because a step of many examples is shorter there than drawing them, and because threads of
    Python draw one at a time. On a processor `ahead` where the steps leave a core to draw on, `in_turn` where they
    leave none.

    Args:
        threads: of the steps.
        device: "cpu" or "cuda"; where the steps run.
    """
    if device != "cpu":
        return functools.partial(in_order, workers=DRAWERS)
    return ahead if threads < joblib.cpu_count() else in_turn
