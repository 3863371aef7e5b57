"""What an episode is, before anything is simulated: what is asked for, in which words, and what lies where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from equigrasp.workspace import Motion
from tasks.arrangement import arrange, check_clearance
from tasks.goal import Goal
from tasks.instructions import PhrasingSet, render
from tasks.objects import ObjectAsset
from tasks.task import Task


@dataclass(frozen=True, eq=False)
class Episode:
    """A scene and its instructions, one for each of its things, in the order in which they are given.

    Attributes:
        goals: what is asked for.
        sentences: in which words.
        assets: the things.
        poses: where they are put down.
    """

    goals: tuple[Goal, ...]
    sentences: tuple[str, ...]
    assets: tuple[ObjectAsset, ...]
    poses: tuple[Motion, ...]


class EpisodeDraw:
    """Draws the episodes of a task.

    Args:
        task: whose.
        phrasings: "seen", those that demonstrations use, or "unseen", kept out of training.
        clearance: metres between two things when a scene is laid out, 0.001 at least.

    Raises:
        ValueError: if there is no such set of phrasings, or the clearance is not 0.001 or more.
    """

    def __init__(self, task: Task, phrasings: PhrasingSet, clearance: float) -> None:
        check_clearance(clearance)
        self.task = task
        self.clearance = clearance
        self._phrasings: Mapping[str, Sequence[str]] = {
            goal.kind: task.grammar(goal).phrasings(phrasings) for goal in task.goals
        }

    def __call__(self, rng: np.random.Generator, options: Mapping[str, Any]) -> Episode:
        """Draw one; all chance comes from `rng`. The options are those of `GraspEnv.reset`.

        Raises:
            ValueError: if an option is unknown or out of range; nothing was drawn.
        """
        goal, phrasing = self._check(options)
        fewest, most = self.task.objects
        count = int(rng.integers(fewest, most + 1))
        pool = list(self.task.pool)
        first = None if goal is None else self.task.goals[goal]
        if first is not None:
            pool.remove(first.name)
            count -= 1
        names = [pool[index] for index in rng.permutation(len(pool))[:count]]
        goals = tuple(_any_of(self.task.goals_of(name), rng) for name in names)
        if first is not None:
            goals = (first, *goals)
        sentences = []
        for asked in goals:
            choices = self._phrasings[asked.kind]
            sentences.append(render(asked, _any_of(choices, rng) if phrasing is None else choices[phrasing]))
        assets = tuple(self.task.load(asked) for asked in goals)
        return Episode(goals, tuple(sentences), assets, tuple(arrange(assets, rng, self.clearance)))

    def _check(self, options: Mapping[str, Any]) -> tuple[int | None, int | None]:
        limits = {"goal": len(self.task.goals), "phrasing": min(map(len, self._phrasings.values()))}
        for name, value in options.items():
            if name not in limits:
                raise ValueError(f"reset knows the options 'goal' and 'phrasing', but not {name!r}")
            whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
            if not whole or not 0 <= value < limits[name]:
                raise ValueError(f"the option {name!r} is a whole number from 0 to {limits[name] - 1}, not {value!r}")
        return options.get("goal"), options.get("phrasing")


def _any_of(choices: Sequence[Any], rng: np.random.Generator) -> Any:
    return choices[int(rng.integers(len(choices)))]
