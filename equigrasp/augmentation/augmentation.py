"""Training examples from demonstrations: SE(2) augmentation of a scene, recombination of objects, colours, sentences.

SE(2) augmentation moves the whole scene and its grasp by one g. Recombination is Eq. 2 of the paper used as
data: the best grasp turns with its own object, whatever stands around it. So each object is cut out of its
scene by its height, put down with a g of its own, together with objects of other demonstrations, and the
target's grasp moves by the target's g alone. Of *hard negatives* these others are what is most easily taken for the
target: goals of its own kind, its own thing in other colours. In *crowded* scenes some of them stand where the hand
would come down, and the grasp is the nearest that it is free for (`crowding.py`). What is asked for is said in the
words of any demonstration, and what was demonstrated in one colour is shown in the colours of the others
(`repainting.py`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from equigrasp.augmentation.canvas import Canvas
from equigrasp.augmentation.crowding import beside, nearest_free
from equigrasp.augmentation.cutouts import Cutout, Scene, take_apart
from equigrasp.augmentation.layout import Layout, Moved, Together, heights
from equigrasp.augmentation.repainting import Palette
from equigrasp.augmentation.rephrasing import rephrased
from equigrasp.augmentation.table import above, find_table
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.hand import HAND, Hand
from equigrasp.plan import check_shares
from equigrasp.workspace import WORKSPACE, Motion, Workspace, table_color

OBJECTS = 60
"""Objects that are tried for a place in the hand's way before it is left free."""
COMPANY = 4
"""Other objects at most, where a demonstration showed its target alone."""
SAME_THING = 0.5
"""Share of the other objects that are the target's thing in another colour, of hard negatives."""


@dataclass(frozen=True)
class Example:
    """What a policy is trained on: `grasp` is right for `instruction` in `observation`."""

    observation: Observation
    instruction: str
    grasp: Grasp


@dataclass(frozen=True, eq=False)
class Sketch:
    """An example before it is painted."""

    layout: Layout
    instruction: str
    grasp: Grasp

    def painted(self, workspace: Workspace) -> Example:
        """The example, on that grid."""
        return Example(self.layout.paint(workspace), self.instruction, self.grasp)


class Augmentation:
    """Draws training examples from demonstrations.

    Args:
        demonstrations: at least one.
        recombination: share of the examples, in [0, 1], that are scenes put together anew; the others are
            demonstrations moved as a whole.
        hard_negatives: share of the scenes put together anew, in [0, 1], whose other objects are like the target.
        crowded: share of the scenes put together anew, in [0, 1], in which objects are put where the hand would come
            down. Unless it is 0, nothing is in the way of any grasp in a scene put together anew.
        workspace: the grid of the heightmaps.
        hand: for what must be free.

    Raises:
        InputError: if there is no demonstration, a grasp lies outside the heightmap, a share is outside [0, 1], or of
            no recombined scenes some shall be hard or crowded; or a demonstration that is to be recombined shows no
            target that can be told from its table (`cutouts.take_apart`).
    """

    def __init__(
        self,
        demonstrations: Sequence[Demonstration],
        recombination: float,
        hard_negatives: float = 0.0,
        crowded: float = 0.0,
        workspace: Workspace = WORKSPACE,
        hand: Hand = HAND,
    ) -> None:
        if not demonstrations:
            raise InputError("there are no demonstrations to train on; make some with `equigrasp collect`")
        check_shares(recombination, hard_negatives, crowded)
        for each in demonstrations:
            if not workspace.contains(each.grasp):
                raise InputError(
                    f"{each.grasp} lies outside the heightmap of {workspace.rows} x {workspace.columns} pixels; leave "
                    "its demonstration out"
                )
        self.demonstrations = tuple(demonstrations)
        tables = [find_table(each.observation) for each in demonstrations]
        self.tables = tuple(
            table_color(above(each.observation, table)) for each, table in zip(demonstrations, tables, strict=True)
        )
        self.levels = tuple(float(each.level.mean()) for each in tables)
        self.recombination = recombination
        self.hard_negatives = hard_negatives
        self.crowded = crowded
        self.workspace = workspace
        self.hand = hand
        recombined = self.demonstrations if recombination > 0 else ()
        self.scenes = numbered([take_apart(each, workspace) for each in recombined])
        self.sentences = tuple(rephrased(each, recombined) for each in recombined)
        self.palette = Palette(self.scenes)

    @property
    def instructions(self) -> tuple[str, ...]:
        """Every sentence that an example may have, each once."""
        own = [each.instruction for each in self.demonstrations]
        return tuple(dict.fromkeys([*own, *itertools.chain(*self.sentences), *self.palette.sentences]))

    @property
    def most(self) -> int:
        """Objects in an example, at most; of a scene that moves as a whole, one."""
        return 1 + max((len(each.others) or COMPANY for each in self.scenes), default=0)

    def sample(self, rng: np.random.Generator) -> Example:
        """Draw one example; all randomness comes from `rng`."""
        return self.sketch(rng).painted(self.workspace)

    def sketch(self, rng: np.random.Generator) -> Sketch:
        """The example that `sample` draws, before it is painted."""
        index = int(rng.integers(len(self.demonstrations)))
        if rng.random() < self.recombination:
            hard = self.hard_negatives > 0 and rng.random() < self.hard_negatives
            if self.palette.has(self.scenes[index]):
                return self.repainted(self.scenes[index], rng, hard)
            sketch = self.recombined(self.scenes[index], rng, hard)
            sentences = self.sentences[index]
            return replace(sketch, instruction=sentences[int(rng.integers(len(sentences)))])
        return self.moved(index, rng)

    def moved(self, index: int, rng: np.random.Generator) -> Sketch:
        """A demonstration's whole scene under one g, such that the grasp stays in the heightmap."""
        space, demonstration = self.workspace, self.demonstrations[index]
        while True:
            x, y = rng.uniform(-0.2, 0.2) * space.length, rng.uniform(-0.2, 0.2) * space.depth
            motion = Motion(rng.uniform(0.0, 2 * math.pi), x, y)
            grasp = space.move_grasp(motion, demonstration.grasp)
            if space.contains(grasp):
                break
        layout = Moved(index, demonstration, motion, self.tables[index], self.levels[index])
        return Sketch(layout, demonstration.instruction, grasp)

    def recombined(self, scene: Scene, rng: np.random.Generator, hard: bool = False) -> Sketch:
        """The target and as many other objects as its scene had, each under a g of its own.

        An object of another scene is used where its name is known and differs from the target's and from the
        others', and it is said in other words: of the rest nobody said what they are, and a second target would make
        the label wrong. Where it is to be hard, those come first that were asked for by a goal of the same kind.
        """
        asked = scene.demonstration
        named = [each for each in self.scenes if each.target.name != asked.target]
        foreign = [each for each in named if not said_alike(each.demonstration, asked)]
        alike = [each for each in foreign if hard and each.demonstration.kind == asked.kind]
        rest = [each.target for each in foreign if not any(each is other for other in alike)]
        pools = [each.target for each in alike], [*scene.others, *rest]
        shuffled = (pool[index] for pool in pools for index in _shuffled(len(pool), rng))
        return self.together(scene, scene.target, shuffled, asked.instruction, rng)

    def repainted(self, scene: Scene, rng: np.random.Generator, hard: bool = False) -> Sketch:
        """As `recombined`, each object in a colour of its own, asked for in that colour.

        The objects that stood around it are left out: nobody said what they are, and one may be what is asked for now.
        Where it is to be hard, half of the others are the same thing in other colours.
        """
        color = self.palette.color(rng)
        target = self.palette.painted(scene, color, rng)
        scenes = self.palette.scenes
        # painted as they are needed: a scene takes a few, and ten demonstrations have hundreds

        def thing(index: int) -> Scene:
            return scene if hard and rng.random() < SAME_THING else scenes[index]

        drawn = (thing(index) for index in _shuffled(len(scenes), rng))
        shuffled = (self.palette.painted(each, self.palette.color(rng), rng) for each in drawn)
        others = (each for each in shuffled if each.name != target.name)
        return self.together(scene, target, others, self.palette.sentence(scene, color, rng), rng)

    def together(
        self, scene: Scene, target: Cutout, others: Iterable[Cutout], instruction: str, rng: np.random.Generator
    ) -> Sketch:
        """The target and as many of the others, in order, as its scene had, on a bare table, no two of one name.

        A target that was shown alone gets up to `COMPANY` others: with nothing beside it there is nothing to choose.
        Heights are measured from the table until all is in its place; then it lies where the scene's camera saw it.
        """
        number = next(place for place, each in enumerate(self.scenes) if each is scene)
        canvas = Canvas(self.workspace)
        motion = canvas.put(target, rng)
        if motion is None:
            return self.moved(number, rng)
        grasp = self.workspace.move_grasp(motion, scene.demonstration.grasp)
        # one beside its object, as of a hand-guided robot, may leave the heightmap where the object does not
        if not self.workspace.contains(grasp):
            return self.moved(number, rng)
        in_the_way = self._in_the_way(grasp, rng)
        wanted = len(scene.others) or int(rng.integers(COMPANY + 1))
        stand(canvas, others, wanted, in_the_way, rng)
        if self.crowded > 0:
            alone = heights(canvas.placements[:1], self.workspace)
            free = nearest_free(self.hand, canvas.height, alone, grasp, self.workspace)
            if free is None:
                return self.moved(number, rng)
            grasp = free
        layout = Together(number, scene.table, scene.level, tuple(canvas.placements))
        return Sketch(layout, instruction, grasp)

    def _in_the_way(self, grasp: Grasp, rng: np.random.Generator) -> list[NDArray[np.float64]]:
        """Where objects are put that shall be in the hand's way: none, or on one side of it or on both."""
        if self.crowded == 0 or rng.random() >= self.crowded:
            return []
        sides = rng.permutation(beside(self.hand, grasp, self.workspace))
        return list(sides[: rng.integers(1, 3)])


def numbered(scenes: Sequence[Scene]) -> tuple[Scene, ...]:
    """The scenes with all that was cut out of them numbered through, each scene's target before its others."""
    counted = itertools.count()

    def one(cutout: Cutout) -> Cutout:
        return replace(cutout, number=next(counted))

    return tuple(replace(each, target=one(each.target), others=tuple(map(one, each.others))) for each in scenes)


def _shuffled(count: int, rng: np.random.Generator) -> Generator[int]:
    """Indices in random order, drawn when the first is asked for."""
    yield from rng.permutation(count)


def stand(
    canvas: Canvas,
    others: Iterable[Cutout],
    wanted: int,
    in_the_way: list[NDArray[np.float64]],
    rng: np.random.Generator,
) -> None:
    """Put so many objects down, in order, no two of one name: the first in the hand's way, as long as they fit there.

    Args:
        canvas: has the target.
        others: may have fewer objects that fit.
        wanted: how many.
        in_the_way: places (u, v) that are to be near one of them each.
        rng: draws their poses.
    """
    names: set[str] = set()
    too_large: list[Cutout] = []
    tried = 0

    def put(other: Cutout, near: NDArray[np.float64] | None) -> bool:
        if canvas.put(other, rng, near) is None:
            return False
        if other.name is not None:
            names.add(other.name)
        return True

    for other in others:
        if wanted == 0:
            return
        if other.name in names:
            continue
        near = in_the_way[0] if in_the_way else None
        fits = put(other, near)
        wanted -= fits
        tried += 1
        if near is not None and not fits:
            too_large.append(other)
        if fits or tried == OBJECTS:
            in_the_way, tried = in_the_way[1:], 0
    # what does not fit beside the hand stands elsewhere: a target alone would be the easiest scene, not the hardest
    for other in too_large:
        if wanted == 0:
            return
        if other.name not in names:
            wanted -= put(other, None)


def said_alike(one: Demonstration, other: Demonstration) -> bool:
    """Whether the sentence that asks for the one asks for the other's target as well, by any of its parts."""
    if one.kind != other.kind:
        return False
    meant = [[word for word in each.words if word != each.part] for each in (one, other)]
    return meant[0] == meant[1] if any(meant) else one.instruction == other.instruction
