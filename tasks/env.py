"""The Gymnasium environment: hear an instruction, look at the table, say where to grasp."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, get_args

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from equigrasp.grasp import Grasp, Observation
from equigrasp.workspace import WORKSPACE, Motion
from tasks import camera as cameras
from tasks import find_task
from tasks.camera import CameraKind
from tasks.goal import Goal
from tasks.gripper import Phase, fingertip_height
from tasks.instructions import CHARSET, LONGEST, PhrasingSet, render
from tasks.judge import Outcome, judge
from tasks.oracle import best_grasps, see
from tasks.scene import Client, Scene, arrange
from tasks.task import Task

CLEARANCE = 0.012
"""Between two objects when a scene is laid out, metres."""
_ABOVE = 0.02
"""The fingertips start this high above everything near, metres."""
_HAND = 0.14
"""What is seen nearer to the grasp than this, metres, might be under the hand."""


class GraspEnv(gymnasium.Env[dict[str, Any], NDArray[np.int64]]):
    """Language-conditioned grasping, several objects an episode.

    A scene holds n objects (4 or 5), and an episode asks for each of them once, in random order, each time with
    a random goal of that object. A grasp that does what the instruction says earns 1/n, its object is
    taken away, and the next instruction comes. After any other grasp, what was lifted is put down and released
    where it is, and the same instruction stands. There are n + 1 trials. The episode is terminated when
    everything was picked, and truncated when the trials are used up.

    Observation: `color` `(H, W, 3)` uint8 and `height` `(H, W)` float32 in metres, a heightmap as in
    `equigrasp.grasp.Observation`, and `instruction`, a sentence.

    Action: `(u, v, bin)`, a pixel's column and row and the bin of the closing axis's angle, as in
    `equigrasp.workspace`.

    Args:
        task: a name in `tasks.TASKS`, or a row of your own.
        camera: "fused", three RGB-D cameras around the table as in the paper, or "overhead", the fast one.
        render_mode: "rgb_array" for pictures by `render`, or None.
        phrasings: "seen", those that demonstrations use, or "unseen", kept out of training.
        clearance: metres between two objects when a scene is laid out.

    Raises:
        ValueError: if an argument is none of these.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012 - as Gymnasium has it

    def __init__(
        self,
        task: str | Task = "pick-by-part",
        camera: CameraKind = "fused",
        render_mode: Literal["rgb_array"] | None = None,
        phrasings: PhrasingSet = "seen",
        clearance: float = CLEARANCE,
    ) -> None:
        if camera not in get_args(CameraKind):
            raise ValueError(f"camera is 'fused' or 'overhead', but this is {camera!r}")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode is 'rgb_array' or None, but this is {render_mode!r}")
        self.task = find_task(task) if isinstance(task, str) else task
        if not isinstance(task, str):
            task.check()
        self.camera = camera
        self.render_mode = render_mode
        self.clearance = clearance
        self._phrasings = {goal.kind: self.task.grammar(goal).phrasings(phrasings) for goal in self.task.goals}
        rows, columns = WORKSPACE.shape
        self.observation_space = spaces.Dict(
            {
                "color": spaces.Box(0, 255, (rows, columns, 3), np.uint8),
                "height": spaces.Box(0.0, 1.0, (rows, columns), np.float32),
                "instruction": spaces.Text(LONGEST, charset=CHARSET),
            }
        )
        self.action_space = spaces.MultiDiscrete([columns, rows, WORKSPACE.bins])
        self._limits = np.array([columns, rows, WORKSPACE.bins])
        self._bullet: Client | None = None
        self._scene: Scene | None = None
        self._goals: list[Goal] = []
        self._sentences: list[str] = []
        self._done = 0
        self._trials = 0
        self._observation: Observation | None = None
        self._overhead: tuple[Observation, NDArray[np.int32]] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay out a new scene. The same seed and options give the same bits, whatever came before.

        Args:
            seed: of everything that is random in the episodes from here on.
            options: "goal", an index into `task.goals`: the first instruction asks for it; "phrasing", an index
                into the set of phrasings: every instruction of the episode uses it. Both may be left out.

        Raises:
            ValueError: if an option is unknown or out of range.
        """
        goal, phrasing = self._check_options(options or {})
        super().reset(seed=seed)
        rng = self.np_random
        fewest, most = self.task.objects
        count = int(rng.integers(fewest, most + 1))
        pool = list(self.task.pool)
        first = None if goal is None else self.task.goals[goal]
        if first is not None:
            pool.remove(first.name)
            count -= 1
        names = [pool[index] for index in rng.permutation(len(pool))[:count]]
        goals = [self._any_goal(name) for name in names]
        self._goals = goals if first is None else [first, *goals]
        self._sentences = [render(asked, self._any_phrasing(asked, phrasing)) for asked in self._goals]
        assets = [self.task.load(asked) for asked in self._goals]
        poses = arrange(assets, rng, self.clearance)
        if self._bullet is None:
            self._bullet = Client()
        self._scene = Scene(self._bullet, assets, poses)
        self._done = 0
        self._trials = len(self._goals) + 1
        self._forget()
        return self._look(), self._info(None)

    def step(self, action: ArrayLike) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Try the grasp `(u, v, bin)`.

        Raises:
            ValueError: if the action is not three whole numbers in range.
            RuntimeError: before the first reset, and after the episode's end.
        """
        outcome = self.attempt(WORKSPACE.to_grasp(self._check_action(action)))
        reward = 1.0 / len(self._goals) if outcome.success else 0.0
        return self._look(), reward, self.terminated, self.truncated, self._info(outcome)

    def attempt(self, grasp: Grasp, watch: Callable[[Phase], None] | None = None) -> Outcome:
        """Try a grasp that need not lie on a pixel's centre or a bin's angle; `step` without its observation.

        Args:
            grasp: within the heightmap.
            watch: called with the phase ("approach", "close", "lift", "put down") after each simulated step of
                the hand; for photographs and films.

        Raises:
            ValueError: if the grasp lies outside the heightmap.
            RuntimeError: before the first reset, and after the episode's end.
        """
        scene, goal = self._playing(), self._goals[self._done]
        if not WORKSPACE.contains(grasp):
            raise ValueError(f"{grasp} lies outside the heightmap of {WORKSPACE.columns}x{WORKSPACE.rows} pixels")
        outcome = judge(goal, *_grasp(scene, grasp, self.observation, watch))
        self._trials -= 1
        if outcome.success:
            scene.take(goal.name)
            self._done += 1
        else:
            scene.put_down()
        self._forget()
        return outcome

    def oracle(self, tries: int = 1) -> tuple[Grasp, float]:
        """The scripted oracle's grasp for the current goal, and its own score of it in [0, 1].

        Args:
            tries: with more than one, so many different grasps are rehearsed at most, best first, each from the
                state as it is now, which comes back; the first that succeeds is given, or else the best.

        Raises:
            ValueError: if there are no tries.
            RuntimeError: before the first reset, and after the episode's end.
        """
        if tries < 1:
            raise ValueError(f"an oracle needs at least one try, but tries is {tries}")
        scene, goal = self._playing(), self._goals[self._done]
        view, segmentation = self._overhead_view()
        grasps = best_grasps(see(scene, goal, view, segmentation), tries)
        if tries > 1:
            for grasp, quality in grasps:
                with scene.rehearsal():
                    outcome = judge(goal, *_grasp(scene, grasp, self.observation, None))
                if outcome.success:
                    return grasp, quality
        return grasps[0]

    def turn_target(self, angle: float) -> Motion:
        """Turn the current goal's object alone by `angle` radians; see `Scene.turn`."""
        motion = self._playing().turn(self.goal.name, angle)
        self._forget()
        return motion

    @property
    def observation(self) -> Observation:
        """The heightmap as it is now."""
        if self._observation is None:
            if self.camera == "overhead":
                self._observation = self._overhead_view()[0]
            else:
                self._observation = cameras.fused(self._started()[0])
        return self._observation

    @property
    def instruction(self) -> str:
        """The current sentence; the last one after the episode's end."""
        self._started()
        return self._sentences[min(self._done, len(self._sentences) - 1)]

    @property
    def goal(self) -> Goal:
        """The current goal; the last one after the episode's end."""
        self._started()
        return self._goals[min(self._done, len(self._goals) - 1)]

    @property
    def terminated(self) -> bool:
        """Whether everything was picked."""
        return self._done == len(self._goals)

    @property
    def truncated(self) -> bool:
        """Whether the trials are used up and not everything was picked."""
        return self._trials == 0 and not self.terminated

    def render(self) -> NDArray[np.uint8] | None:
        """A picture `(480, 640, 3)` of the table and, during an attempt, the hand; None without a render mode."""
        return None if self.render_mode is None else cameras.portrait(self._started()[0])

    def close(self) -> None:
        """Free the simulator. Closing twice does nothing more."""
        if self._bullet is not None:
            self._bullet.disconnect()
        self._bullet = self._scene = None

    def _started(self) -> tuple[Client, Scene]:
        if self._bullet is None or self._scene is None:
            raise RuntimeError("there is no scene yet: call reset() first")
        return self._bullet, self._scene

    def _playing(self) -> Scene:
        _, scene = self._started()
        if self.terminated or self.truncated:
            raise RuntimeError("the episode is over: call reset() before the next grasp")
        return scene

    def _overhead_view(self) -> tuple[Observation, NDArray[np.int32]]:
        if self._overhead is None:
            self._overhead = cameras.overhead(self._started()[0])
        return self._overhead

    def _forget(self) -> None:
        self._observation = self._overhead = None

    def _look(self) -> dict[str, Any]:
        seen = self.observation
        # copies: what an agent does to its observation must not reach the hand, which reads the height
        return {"color": seen.color.copy(), "height": seen.height.copy(), "instruction": self.instruction}

    def _info(self, outcome: Outcome | None) -> dict[str, Any]:
        goal = self.goal
        return {
            "goal": {
                "name": goal.name,
                "object": goal.object,
                "color": goal.color,
                "part": goal.part,
                "kind": goal.kind,
                "words": self.task.grammar(goal).words(goal),
                "index": self.task.goals.index(goal),
            },
            "trials_left": self._trials,
            "outcome": {} if outcome is None else outcome.as_dict(),
            "objects": self._started()[1].truth(),
        }

    def _any_goal(self, name: str) -> Goal:
        choices = self.task.goals_of(name)
        return choices[int(self.np_random.integers(len(choices)))]

    def _any_phrasing(self, goal: Goal, asked: int | None) -> str:
        choices = self._phrasings[goal.kind]
        return choices[int(self.np_random.integers(len(choices))) if asked is None else asked]

    def _check_options(self, options: dict[str, Any]) -> tuple[int | None, int | None]:
        limits = {"goal": len(self.task.goals), "phrasing": min(map(len, self._phrasings.values()))}
        for name, value in options.items():
            if name not in limits:
                raise ValueError(f"reset knows the options 'goal' and 'phrasing', but not {name!r}")
            whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
            if not whole or not 0 <= value < limits[name]:
                raise ValueError(f"the option {name!r} is a whole number from 0 to {limits[name] - 1}, not {value!r}")
        return options.get("goal"), options.get("phrasing")

    def _check_action(self, action: ArrayLike) -> NDArray[np.int64]:
        values = np.asarray(action)
        if (
            values.shape != (3,)
            or not np.issubdtype(values.dtype, np.integer)
            or (values < 0).any()
            or (values >= self._limits).any()
        ):
            raise ValueError(
                f"an action is three whole numbers (u, v, bin) from 0 to {(self._limits - 1).tolist()}, not {action!r}"
            )
        return values.astype(np.int64)


def _grasp(
    scene: Scene, grasp: Grasp, seen: Observation, watch: Callable[[Phase], None] | None
) -> tuple[list[str], dict[str, list[str | None]]]:
    """Where the hand goes for this grasp, by the heightmap that was seen; then `Scene.grasp`."""
    x, y = WORKSPACE.to_world([grasp.u, grasp.v]).tolist()
    u, v, _ = WORKSPACE.to_action(grasp)
    side = round(_HAND / WORKSPACE.pixel)
    near = seen.height[max(v - side, 0) : v + side + 1, max(u - side, 0) : u + side + 1]
    start = float(near.max()) + _ABOVE
    return scene.grasp(x, y, grasp.theta, start, fingertip_height(float(seen.height[v, u])), watch)
