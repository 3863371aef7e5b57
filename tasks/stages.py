"""Where the simulator's time goes: an episode of the oracle, every stage of it on a stopwatch.

The stages are functions of the suite, and the episode is `GraspEnv`'s own; for as long as it runs, each function is
replaced by one that stops the time around it. Time within an inner stage is the inner one's alone: settling after a
grasp counts as settling.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from equigrasp.workspace import WORKSPACE
from tasks import camera
from tasks import env as environment
from tasks.env import GraspEnv
from tasks.episode import EpisodeDraw
from tasks.scene import Scene

STAGES: dict[str, tuple[tuple[Any, str], ...]] = {
    "draw": ((EpisodeDraw, "__call__"),),
    "scene": ((Scene, "__init__"),),
    "settle": ((Scene, "_settle"),),
    "observe": ((camera, "overhead"), (camera, "fused")),
    "plan": ((GraspEnv, "oracle"),),
    "grasp": ((Scene, "grasp"), (Scene, "put_down"), (Scene, "take")),
    "judge": ((environment, "judge"),),
}
"""Stage -> the functions that are it."""
REST = "rest"
"""What is none of them: checks, copies, `info`."""


class Stopwatch:
    """Seconds by stage, each without what is within it.

    Attributes:
        seconds: by stage; `REST` for what was in none.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.seconds = dict.fromkeys([*STAGES, REST], 0.0)
        self._clock = clock
        self._stack = [REST]
        self._since = clock()

    def enter(self, stage: str) -> None:
        """From now on time is this stage's."""
        self._lap()
        self._stack.append(stage)

    def leave(self) -> None:
        """From now on time is that of the stage around this one."""
        self._lap()
        self._stack.pop()

    def finish(self) -> dict[str, float]:
        """The seconds until now."""
        self._lap()
        return self.seconds

    def _lap(self) -> None:
        now = self._clock()
        self.seconds[self._stack[-1]] += now - self._since
        self._since = now


@contextmanager
def watched(stopwatch: Stopwatch) -> Generator[None]:
    """Within this, every stage is timed."""
    with ExitStack() as stack:
        for stage, functions in STAGES.items():
            for owner, name in functions:
                stack.enter_context(patch.object(owner, name, _timed(stopwatch, stage, getattr(owner, name))))
        yield


def _timed(stopwatch: Stopwatch, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
    def timed(*arguments: Any, **options: Any) -> Any:
        stopwatch.enter(stage)
        try:
            return function(*arguments, **options)
        finally:
            stopwatch.leave()

    return timed


def play(env: GraspEnv, seed: int) -> int:
    """An episode of the oracle from reset to its end; how many grasps it was."""
    env.reset(seed=seed)
    grasps = 0
    while not (env.terminated or env.truncated):
        env.step(WORKSPACE.to_action(env.oracle()[0]))
        grasps += 1
    return grasps


def stages(env: GraspEnv, seed: int) -> tuple[dict[str, float], int]:
    """Seconds by stage of one episode, and its grasps."""
    stopwatch = Stopwatch()
    with watched(stopwatch):
        grasps = play(env, seed)
    return stopwatch.finish(), grasps


class Episodes:
    """Episodes of one task, from their seed to how many grasps they were; for any engine.

    Args:
        make_env: makes the environment, once in each process; it must pickle where the engine has others.
    """

    def __init__(self, make_env: Callable[[], GraspEnv]) -> None:
        self._make_env = make_env
        self._env: GraspEnv | None = None

    def __call__(self, seed: int) -> int:
        """Play the episode."""
        if self._env is None:
            self._env = self._make_env()
        return play(self._env, seed)

    def __reduce__(self) -> tuple[type[Episodes], tuple[Callable[[], GraspEnv]]]:
        """A copy for another process makes an environment of its own."""
        return Episodes, (self._make_env,)

    def close(self) -> None:
        """Close the environment, if one was made here."""
        if self._env is not None:
            self._env.close()
