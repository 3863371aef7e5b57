"""Proposition 1 in the simulator: the same scene, the target alone turned by g, and where the best grasp goes.

Here nothing is analytic: objects have sides that a camera sees or not, phi is what training made of it, and a part
may have two grasps that are equally good. So the error is measured, in pixels and degrees, and what it costs in lifts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from equigrasp.environment import Environment
from equigrasp.errors import InputError
from equigrasp.evaluation import Act, scene_seed
from equigrasp.grasp import Grasp
from equigrasp.success import Rate
from equigrasp.workspace import WORKSPACE, Motion

TRIES = 12
"""Angles that are tried in a scene before it is left out: objects lie close, and turning one needs room."""
PIXELS, DEGREES = 4.0, 10.0
"""A grasp that is within this of where it should be has followed: 12.5 mm, two bins."""


class TurnableEnvironment(Environment, Protocol):
    """An environment whose current target can be turned alone, as `tasks.env.GraspEnv`'s."""

    def turn_target(self, angle: float) -> Motion:
        """Turn it by `angle` radians; the motion in world coordinates; ValueError where there is no room."""
        ...

    def attempt(self, grasp: Grasp) -> Any:
        """Try a grasp; gives an outcome with `success` and `grasped`."""
        ...


@dataclass(frozen=True)
class Turned:
    """One scene before and after its target was turned.

    Attributes:
        seed: what the environment was reset with.
        instruction: what was said, both times.
        degrees: by which the target turned.
        before: (u, v, theta) chosen in the scene as it was; pixels, pixels, radians.
        after: chosen in the turned scene.
        pixels: from g times `before` to `after`.
        off: degrees between their closing axes, at most 90.
        success_before: whether the first grasp did what was asked.
        success_after: whether the second one did, in the turned scene.
    """

    seed: int
    instruction: str
    degrees: float
    before: tuple[float, float, float]
    after: tuple[float, float, float]
    pixels: float
    off: float
    success_before: bool
    success_after: bool

    @property
    def followed(self) -> bool:
        """Whether the grasp went where g takes it, within 4 pixels and 10 degrees."""
        return self.pixels <= PIXELS and self.off <= DEGREES


@dataclass(frozen=True)
class Follow:
    """All scenes of a measurement.

    Attributes:
        trials: in order.
        crowded: scenes that were left out, because no tried angle had room.
    """

    trials: tuple[Turned, ...]
    crowded: int

    @property
    def followed(self) -> Rate:
        """Of all scenes, those whose grasp followed."""
        return Rate(sum(trial.followed for trial in self.trials), len(self.trials))

    def lines(self) -> list[str]:
        """For a terminal."""
        if not self.trials:
            return [f"no scene had room to turn its target ({self.crowded} tried)"]
        pixels, off = (np.median([getattr(trial, name) for trial in self.trials]) for name in ("pixels", "off"))
        before, after = (
            Rate(sum(getattr(trial, name) for trial in self.trials), len(self.trials))
            for name in ("success_before", "success_after")
        )
        return [
            f"the grasp followed within {PIXELS:.0f} px and {DEGREES:.0f} degrees: {self.followed}",
            f"median error {pixels:.1f} px, {off:.1f} degrees; {self.crowded} scenes had no room to turn",
            f"right object by the right part: {before} as it was, {after} turned",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {"crowded": self.crowded, "trials": [asdict(trial) for trial in self.trials]}


def proposition_1(
    act: Act,
    env: TurnableEnvironment,
    scenes: int,
    seed: int = 0,
    progress: Callable[[range], Iterable[int]] = iter,
) -> Follow:
    """Ask for a grasp, turn the target alone by a random angle of whole bins, ask again, try both.

    Args:
        act: the policy: observation and instruction to grasp.
        env: of any task; one grasp a scene is asked for.
        scenes: how many.
        seed: which scenes and angles, from 0 to 999.
        progress: wraps the range of scenes, for a progress bar.

    Raises:
        InputError: if there is no scene to look at.
    """
    if scenes < 1:
        raise InputError(f"the number of simulated scenes is {scenes}, but it must be at least 1")
    trials, crowded = [], 0
    for index in progress(range(scenes)):
        start = scene_seed(seed, index)
        rng = np.random.default_rng([seed, index])
        env.reset(seed=start)
        before = act(env.observation, env.instruction)
        success_before = bool(env.attempt(before).success)
        # the same seed lays out the same scene, to the bit
        env.reset(seed=start)
        turned = _turn(env, rng)
        if turned is None:
            crowded += 1
            continue
        degrees, motion = turned
        instruction = env.instruction
        after = act(env.observation, instruction)
        expected = WORKSPACE.move_grasp(motion, before)
        off = abs((after.theta - expected.theta + math.pi / 2) % math.pi - math.pi / 2)
        trials.append(
            Turned(
                start,
                instruction,
                degrees,
                (before.u, before.v, before.theta),
                (after.u, after.v, after.theta),
                math.hypot(after.u - expected.u, after.v - expected.v),
                math.degrees(off),
                success_before,
                bool(env.attempt(after).success),
            )
        )
    return Follow(tuple(trials), crowded)


def _turn(env: TurnableEnvironment, rng: np.random.Generator) -> tuple[float, Motion] | None:
    for _ in range(TRIES):
        degrees = 5.0 * int(rng.integers(2, 71))
        try:
            return degrees, env.turn_target(math.radians(degrees))
        except ValueError:
            continue
    return None
