"""How hard the tasks are: what the scripted oracle picks, and what chance would.

A benchmark that any grasp on the target passes says nothing about where and at what angle a policy grasps. So the
oracle is set beside two actors that know which object is meant, and part of where, but never the angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from equigrasp.errors import InputError
from equigrasp.grasp import Grasp
from equigrasp.workspace import WORKSPACE
from tasks.camera import CameraKind
from tasks.env import GraspEnv
from tasks.judge import Reason
from tasks.task import Task

FIRST_SEED = 2 * 10**9
"""Scenes of these measurements have seeds from here on; demonstrations' and evaluations' are lower."""


@dataclass(frozen=True)
class FirstTry:
    """The first grasp for one goal of a scene.

    Attributes:
        seed: the scene's.
        goal: what was asked for, in words.
        lifted: the goal's object was lifted and nothing else.
        right: and by the right part, where one was asked for.
        reason: the judge's word.
        quality: the oracle's own score of its grasp, in [0, 1]; NaN for the other actors.
    """

    seed: int
    goal: str
    lifted: bool
    right: bool
    reason: Reason
    quality: float


def on_a_pixel(env: GraspEnv, rng: np.random.Generator) -> Grasp:
    """Any pixel of the target (or of its part), any angle.

    Raises:
        InputError: if not a pixel of it is to be seen.
    """
    v, u = np.nonzero(env.truth().on_part)
    if not len(u):
        raise InputError(
            f"the task {env.task.name!r} asks for the {env.goal}, of which the overhead camera shows not a pixel, so "
            "that chance has nothing to aim at; ask for another part, or measure the oracle alone (--no-chance)"
        )
    index = int(rng.integers(len(u)))
    return Grasp(float(u[index]), float(v[index]), rng.uniform(0.0, math.pi))


def on_the_centre(env: GraspEnv, rng: np.random.Generator) -> Grasp:
    """The target's centre of mass, any angle."""
    u, v = np.clip(WORKSPACE.to_pixel(env.truth().center), 0, [WORKSPACE.columns - 1, WORKSPACE.rows - 1])
    return Grasp(float(u), float(v), rng.uniform(0.0, math.pi))


CHANCE: dict[str, Callable[[GraspEnv, np.random.Generator], Grasp]] = {
    "any pixel of the target, any angle": on_a_pixel,
    "the target's centre, any angle": on_the_centre,
}
"""Actors that know what is meant and guess the rest."""

ORACLE = "oracle"


@dataclass
class Scenes:
    """One actor in scenes of one task: a callable from the scene's number to its first tries, for any engine.

    The oracle tries every goal of a scene once and goes on while it succeeds: a failure moves things, and what
    comes after is another scene. Chance tries the first goal alone.

    Attributes:
        task: which.
        actor: `ORACLE` or a key of `CHANCE`.
        camera: the environment's.
        clearance: metres between two objects when a scene is laid out, 0.001 at least.
    """

    task: Task
    actor: str
    camera: CameraKind = "overhead"
    clearance: float = 0.012

    def __post_init__(self) -> None:
        self._env: GraspEnv | None = None

    def __call__(self, number: int) -> list[FirstTry]:
        """The first tries in scene `number`."""
        if self._env is None:
            self._env = GraspEnv(self.task, camera=self.camera, clearance=self.clearance)
        env, seed = self._env, FIRST_SEED + number
        env.reset(seed=seed)
        tries = []
        while not tries or (self.actor == ORACLE and tries[-1].right and not env.terminated):
            goal, quality = env.goal, math.nan
            if self.actor == ORACLE:
                grasp, quality = env.oracle()
            else:
                grasp = CHANCE[self.actor](env, np.random.default_rng([seed, len(self.actor)]))
            outcome = env.attempt(grasp)
            tries.append(FirstTry(seed, str(goal), outcome.correct_object, outcome.success, outcome.reason, quality))
        return tries

    def close(self) -> None:
        """Close the environment, if one was made here."""
        if self._env is not None:
            self._env.close()
