"""What a task is: a row that says which goals there are, which objects fill a scene, and how one speaks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Goal:
    """What an instruction asks for.

    Attributes:
        object: the object's name, as in `tasks.objects.OBJECTS`.
        part: the part to take it by, or None where any part will do.
    """

    object: str
    part: str | None = None

    def __str__(self) -> str:
        return self.object if self.part is None else f"{self.object} by {self.part}"


@dataclass(frozen=True)
class Task:
    """A row of `tasks.TASKS`.

    Attributes:
        name: as on the command line.
        env_id: the environment's id in Gymnasium.
        goals: everything that can be asked for; an instruction names one of them.
        phrasing: which grammar of `tasks.instructions.PHRASINGS` speaks.
        objects: fewest and most objects in a scene.

    Raises:
        ValueError: if a scene could not be filled with different objects.
    """

    name: str
    env_id: str
    goals: tuple[Goal, ...]
    phrasing: str
    objects: tuple[int, int] = (4, 5)

    def __post_init__(self) -> None:
        fewest, most = self.objects
        if not 1 <= fewest <= most <= len(self.pool):
            raise ValueError(
                f"the scenes of {self.name!r} hold {fewest} to {most} different objects, "
                f"but its goals name {len(self.pool)}"
            )

    @property
    def pool(self) -> tuple[str, ...]:
        """The names of the objects that fill its scenes, each once, in the order of the goals."""
        return tuple(dict.fromkeys(goal.object for goal in self.goals))

    def demonstration_goals(self, rng: np.random.Generator) -> tuple[int, ...]:
        """The goals of one demonstration, as indices, in order: here each goal once."""
        return tuple(range(len(self.goals)))

    def goals_of(self, name: str) -> tuple[Goal, ...]:
        """The goals that ask for the object of this name."""
        return tuple(goal for goal in self.goals if goal.object == name)


def by_part(parts: Mapping[str, tuple[str, ...]]) -> tuple[Goal, ...]:
    """A goal for each part of each object: `by_part({"mug": ("brim", "handle")})`."""
    return tuple(Goal(name, part) for name, listed in parts.items() for part in listed)
