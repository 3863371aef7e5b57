"""What is to be collected: which goals each demonstration has, and in which scene each grasp is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from equigrasp.errors import InputError
from equigrasp.workspace import WORKSPACE

TRIES = 10
"""Scenes in which the oracle may try each grasp."""
SEEDS_PER_RUN = 10**6
"""How many scenes belong to one `--seed`: scene seeds of different runs never meet."""

Place = tuple[int, int]
"""Where a grasp belongs: the index of its demonstration, and its own in that demonstration."""


@dataclass(frozen=True)
class Collection:
    """What is to be collected.

    Attributes:
        task: the task's name.
        goals: for each demonstration the indices of its goals, one grasp each, in order; see `draw_goals`.
        seed: which scenes, from 0 to 999; other seeds give other scenes, and none is an evaluation's scene.
        camera: the environment's camera.
        row: of a task of one's own, what its row is now, as `tasks.Task.fingerprint` says it; None for the suite's.

    Raises:
        InputError: if there is no demonstration, one without a grasp, more grasps than scenes, or the seed is
            out of range.
    """

    task: str
    goals: tuple[tuple[int, ...], ...]
    seed: int
    camera: str
    row: str | None = None

    def __post_init__(self) -> None:
        check_seed(self.seed)
        check_demos(self.demos)
        if not all(self.goals):
            raise InputError(f"demonstration {self.goals.index(())} of {self.task} has no goal")
        count, most = len(self.grasps()), SEEDS_PER_RUN // TRIES
        if count > most:
            raise InputError(f"--demos is {self.demos}, which is {count} grasps, but a seed has scenes for {most}")

    @property
    def demos(self) -> int:
        """How many demonstrations."""
        return len(self.goals)

    def plan(self) -> dict[str, Any]:
        """All that determines the files, as JSON."""
        return {
            "task": self.task,
            "demos": self.demos,
            "seed": self.seed,
            "camera": self.camera,
            "heightmap": list(WORKSPACE.shape),
            "goals": [list(goals) for goals in self.goals],
            **({} if self.row is None else {f"row of {self.task}": self.row}),
        }

    @classmethod
    def of_plan(cls, plan: Any) -> Collection:
        """The inverse of `plan`.

        Raises:
            InputError: if this is no such plan, or its heightmaps have another size than the workspace's.
        """
        try:
            goals = tuple(tuple(int(goal) for goal in goals) for goals in plan["goals"])
            row = plan.get(f"row of {plan['task']}")
            row = None if row is None else str(row)
            collection = cls(str(plan["task"]), goals, int(plan["seed"]), str(plan["camera"]), row)
            same = {key: plan[key] for key in collection.plan()} == collection.plan()
        except (TypeError, KeyError, ValueError) as error:
            raise InputError(f"this is no plan of a collection ({type(error).__name__}: {error})") from None
        if not same:
            raise InputError(f"this is no plan of a collection for heightmaps of {list(WORKSPACE.shape)} pixels")
        return collection

    def scene_seed(self, demo: int, grasp: int, attempt: int) -> int:
        """The seed that the environment is reset with; that of a demo does not depend on how many follow it."""
        before = sum(len(goals) for goals in self.goals[:demo])
        return self.seed * SEEDS_PER_RUN + (before + grasp) * TRIES + attempt

    def grasps(self) -> list[Place]:
        """All (demo, grasp) pairs, in order."""
        return [(demo, grasp) for demo, goals in enumerate(self.goals) for grasp in range(len(goals))]


def draw_goals(
    choose: Callable[[np.random.Generator], tuple[int, ...]], demos: int, seed: int
) -> tuple[tuple[int, ...], ...]:
    """The goals of each demonstration; those of demo k are the same however many there are.

    Args:
        choose: draws the goals of one demonstration, as `tasks.Task.demonstration_goals` does.
        demos: how many demonstrations.
        seed: the collection's.

    Raises:
        InputError: if demos or seed are out of range, or these demonstrations have more grasps than there are scenes.
    """
    check_seed(seed)
    check_demos(demos)
    goals, left = [], SEEDS_PER_RUN // TRIES
    for demo in range(demos):
        goals.append(choose(np.random.default_rng([seed, demo])))
        left -= len(goals[-1])
        # a hundred thousand draws take a while, and the first few thousand may be too many already
        if left < 0:
            raise InputError(
                f"--demos is {demos}, but a seed has scenes for {SEEDS_PER_RUN // TRIES} grasps, and these "
                f"demonstrations have more; ask for at most {demo}"
            )
    return tuple(goals)


def check_seed(seed: int) -> None:
    """Raise InputError unless the seed is from 0 to 999."""
    if not 0 <= seed < 1000:
        raise InputError(f"--seed is {seed}, but it must be from 0 to 999")


def check_demos(demos: int) -> None:
    """Raise InputError unless there are demonstrations, and no more than there are scenes for."""
    most = SEEDS_PER_RUN // TRIES
    if not 1 <= demos <= most:
        raise InputError(f"--demos is {demos}, but it must be from 1 to {most}")


def file_name(demo: int, grasp: int) -> str:
    """Name of the file that holds one grasp."""
    return f"demo-{demo:03d}-grasp-{grasp:03d}.npz"
