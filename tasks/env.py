"""The Gymnasium environment: hear an instruction, look at the table, say where to grasp."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, Literal, SupportsIndex, get_args

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from equigrasp.errors import InputError
from equigrasp.grasp import Grasp, Observation
from equigrasp.workspace import WORKSPACE, Motion
from tasks import camera as cameras
from tasks import find_task
from tasks.camera import CameraKind
from tasks.episode import EpisodeDraw
from tasks.goal import Goal
from tasks.gripper import STEP, Phase, reach
from tasks.instruction_space import InstructionSpace
from tasks.instructions import PhrasingSet
from tasks.judge import Outcome, judge
from tasks.oracle import Truth, best_grasps, see
from tasks.scene import Client, Scene
from tasks.task import Task
from tasks.window import Window

CLEARANCE = 0.012
"""Between two objects when a scene is laid out, metres."""


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
        render_mode: "rgb_array" for pictures by `render`, "human" for a window that shows the hand at work, or None.
        phrasings: "seen", those that demonstrations use, or "unseen", kept out of training.
        clearance: metres between two objects when a scene is laid out, 0.001 at least.

    Raises:
        ValueError: if an argument is none of these.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 20}  # noqa: RUF012 - as Gymnasium has it

    def __init__(
        self,
        task: str | Task = "pick-by-part",
        camera: CameraKind = "fused",
        render_mode: Literal["human", "rgb_array"] | None = None,
        phrasings: PhrasingSet = "seen",
        clearance: float = CLEARANCE,
    ) -> None:
        if camera not in get_args(CameraKind):
            raise ValueError(f"camera is 'fused' or 'overhead', but this is {camera!r}")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode is 'human', 'rgb_array' or None, but this is {render_mode!r}")
        self.task = find_task(task) if isinstance(task, str) else task
        if not isinstance(task, str):
            task.check()
        self.camera = camera
        self.render_mode = render_mode
        self._draw = EpisodeDraw(self.task, phrasings, clearance)
        rows, columns = WORKSPACE.shape
        self.observation_space = spaces.Dict(
            {
                "color": spaces.Box(0, 255, (rows, columns, 3), np.uint8),
                "height": spaces.Box(0.0, 1.0, (rows, columns), np.float32),
                "instruction": InstructionSpace(),
            }
        )
        self.action_space = spaces.MultiDiscrete([columns, rows, WORKSPACE.bins])
        self._limits = np.array([columns, rows, WORKSPACE.bins])
        self._window = None if render_mode != "human" else Window(self.task.name, self.metadata["render_fps"])
        self._bullet: Client | None = None
        self._scene: Scene | None = None
        self._goals: tuple[Goal, ...] = ()
        self._sentences: tuple[str, ...] = ()
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
        super().reset(seed=seed)
        episode = self._draw(self.np_random, options or {})
        if self._bullet is None:
            self._bullet = Client()
        self._scene = Scene(self._bullet, episode.assets, episode.poses)
        self._goals, self._sentences = episode.goals, episode.sentences
        self._done, self._trials = 0, len(self._goals) + 1
        self._forget()
        self._show()
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
        outcome = judge(goal, *scene.grasp(reach(grasp, self._seen()), watch or self._film()))
        self._trials -= 1
        if outcome.success:
            scene.take(goal.name)
            self._done += 1
        else:
            scene.put_down()
        self._forget()
        self._show()
        return outcome

    def oracle(self, tries: int = 1) -> tuple[Grasp, float]:
        """The scripted oracle's grasp for the current goal, and its own score of it in [0, 1].

        Args:
            tries: with more than one, so many different grasps are rehearsed at most, best first, each from where
                things are now; the first that succeeds is given, or else the best. Then all is where it was; how
                the next grasp may differ, `Scene.rehearsal` says.

        Raises:
            ValueError: if there are no tries.
            RuntimeError: before the first reset, and after the episode's end.
        """
        if tries < 1:
            raise ValueError(f"an oracle needs at least one try, but tries is {tries}")
        scene, goal = self._playing(), self._goals[self._done]
        grasps = best_grasps(self.truth(), tries)
        if tries > 1:
            for grasp, quality in grasps:
                with scene.rehearsal():
                    outcome = judge(goal, *scene.grasp(reach(grasp, self._seen())))
                if outcome.success:
                    return grasp, quality
        return grasps[0]

    def truth(self) -> Truth:
        """What the oracle knows of the scene as it is now, for the current goal.

        Raises:
            RuntimeError: before the first reset, and after the episode's end.
        """
        observation, segmentation = self._overhead_view()
        return see(self._playing(), self._goals[self._done], _copy(observation), segmentation.copy())

    def turn_target(self, angle: float) -> Motion:
        """Turn the current goal's object alone by `angle` radians; see `Scene.turn`."""
        motion = self._playing().turn(self.goal.name, angle)
        self._forget()
        return motion

    @property
    def observation(self) -> Observation:
        """The heightmap as it is now, a copy; RuntimeError before the first reset and after `close`."""
        return _copy(self._seen())

    @property
    def instruction(self) -> str:
        """The current sentence; the last one after the episode's end."""
        self.started()
        return self._sentences[min(self._done, len(self._sentences) - 1)]

    @property
    def goal(self) -> Goal:
        """The current goal; the last one after the episode's end."""
        self.started()
        return self._goals[min(self._done, len(self._goals) - 1)]

    @property
    def terminated(self) -> bool:
        """Whether everything was picked; False before the first reset."""
        return 0 < len(self._goals) == self._done

    @property
    def truncated(self) -> bool:
        """Whether the trials are used up and not everything was picked; False before the first reset."""
        return bool(self._goals) and self._trials == 0 and not self.terminated

    def render(self) -> NDArray[np.uint8] | None:
        """A picture `(480, 640, 3)` of the table and, during an attempt, the hand; None but in mode "rgb_array".

        In mode "human" the window is kept up to date by `reset` and `step`, as Gymnasium has it.
        """
        return cameras.portrait(self.started()[0]) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Free the simulator, and close the window. Closing twice does nothing more."""
        if self._window is not None:
            self._window.close()
        if self._bullet is not None:
            self._bullet.disconnect()
        self._bullet = self._scene = None
        self._forget()

    def __reduce_ex__(self, protocol: SupportsIndex, /) -> str | tuple[Any, ...]:
        """What a copy or a pickle is made from.

        Raises:
            InputError: between a reset and `close`.
        """
        # a shallow copy would share the client without asking it
        if self._bullet is not None:
            self._bullet.__reduce__()
        return super().__reduce_ex__(protocol)

    def started(self) -> tuple[Client, Scene]:
        """The simulator's client and the scene in it.

        Raises:
            RuntimeError: before the first reset and after `close`.
        """
        if self._bullet is None or self._scene is None:
            raise RuntimeError("there is no scene yet: call reset() first")
        return self._bullet, self._scene

    def _playing(self) -> Scene:
        _, scene = self.started()
        if self.terminated or self.truncated:
            raise RuntimeError("the episode is over: call reset() before the next grasp")
        return scene

    def _seen(self) -> Observation:
        """What the cameras saw: the hand reads its height, so nobody else may have it but as a copy."""
        if self._observation is None:
            if self.camera == "overhead":
                self._observation = self._overhead_view()[0]
            else:
                self._observation = cameras.fused(self.started()[1].visible())
        return self._observation

    def _overhead_view(self) -> tuple[Observation, NDArray[np.int32]]:
        if self._overhead is None:
            self._overhead = cameras.overhead(self.started()[1].visible())
        return self._overhead

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(cameras.portrait(self.started()[0]), self.instruction)

    def _film(self) -> Callable[[Phase], None] | None:
        """What shows the hand's motion in the window, in real time; None without one."""
        if self._window is None:
            return None
        steps = itertools.count()
        every = round(1 / STEP / self.metadata["render_fps"])

        def watch(phase: Phase) -> None:
            del phase
            if next(steps) % every == 0:
                self._show()

        return watch

    def _forget(self) -> None:
        self._observation = self._overhead = None

    def _look(self) -> dict[str, Any]:
        seen = self.observation
        return {"color": seen.color, "height": seen.height, "instruction": self.instruction}

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
            "objects": self.started()[1].truth(),
        }

    def _check_action(self, action: ArrayLike) -> NDArray[np.int64]:
        if isinstance(action, Grasp):
            raise InputError(
                f"an action is three whole numbers (u, v, bin), not {action!r}; pass WORKSPACE.to_action(grasp), or "
                "try the grasp as it is by env.unwrapped.attempt(grasp)"
            )
        try:
            values = np.asarray(action)
        except ValueError:  # nested lists of different lengths
            values = np.empty(0)
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


def _copy(observation: Observation) -> Observation:
    return Observation(observation.color.copy(), observation.height.copy())
