"""One query looked at closely: what the policy saw, thought and did, with a photograph of the lifted hand."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from equigrasp.grasp import Grasp
    from equigrasp.pictures import Query
    from equigrasp.policy import GraspPolicy
    from equigrasp.success import Trial
    from tasks.env import GraspEnv


def ask(policy: GraspPolicy, env: GraspEnv, seed: int, goal: int | None, instruction: str | None) -> Query:
    """Let the policy grasp once in a fresh scene, with a photograph of the hand after lifting.

    Args:
        policy: who grasps.
        env: where, with a render mode.
        seed: which scene.
        goal: index of the goal, or None for the scene's first.
        instruction: what to say instead of the environment's own sentence.
    """
    import torch

    from equigrasp.pictures import Query
    from equigrasp.policy import to_tensor
    from equigrasp.workspace import WORKSPACE

    env.reset(seed=seed, options=None if goal is None else {"goal": goal})
    observation, sentence = env.observation, instruction or env.instruction
    oracle = env.oracle()[0] if instruction is None else None
    with torch.no_grad():
        scores = policy.log_probabilities(to_tensor(observation)[None], policy.embed(sentence)[None])
    grasp = policy.act(observation, sentence)
    photographs = []
    steps = itertools.count()

    def watch(phase: str) -> None:
        # the hand holds still for its last 12 steps up, so that one of 10 pictures shows it at the top
        if phase == "lift" and next(steps) % 10 == 9 and env.render_mode == "rgb_array":
            photographs.append(close_up(env, grasp))

    # on the pixel and bin that an evaluation's `step` takes, or the picture might show another outcome
    outcome = env.attempt(WORKSPACE.to_grasp(WORKSPACE.to_action(grasp)), watch=watch)
    # as an instruction says it
    lifted = " and ".join(name.replace("-", " ") for name in outcome.lifted)
    by = f" by the {outcome.part}" if outcome.part else ""
    words = f"lifted the {lifted}{by}" if lifted else "nothing lifted"
    return Query(
        observation,
        sentence,
        grasp,
        oracle,
        scores[0].numpy(),
        photographs[-1],
        words,
        outcome.success if instruction is None else outcome.grasped,
    )


def close_up(env: GraspEnv, grasp: Grasp) -> NDArray[np.uint8]:
    """A picture `(270, 360, 3)` of the lifted hand, from so low that the palm does not hide what the fingers hold.

    It looks halfway along the closing axis, from the front: along it one finger would hide the other, and across it a
    handle that they hold would point at the camera.
    """
    import math
    from dataclasses import replace

    import numpy as np

    from equigrasp.workspace import WORKSPACE
    from tasks.camera import looking_at, photograph, portrait_viewpoint
    from tasks.gripper import LIFT

    x, y = WORKSPACE.to_world([grasp.u, grasp.v])
    # of the two sides that are halfway, the one that is more to the front
    side = max(
        (grasp.theta + math.pi / 4 + turn * math.pi / 2 for turn in range(4)), key=lambda angle: -math.sin(angle)
    )
    away, up = 0.55, 0.16
    position = (x + away * math.cos(side), y + away * math.sin(side), LIFT + up)
    pose = looking_at(position, (float(x), float(y), LIFT - 0.01))
    intrinsics = np.array([[560.0, 0.0, 180.0], [0.0, 560.0, 135.0], [0.0, 0.0, 1.0]])
    return photograph(
        env.started()[0], replace(portrait_viewpoint(), intrinsics=intrinsics, pose=pose, size=(270, 360))
    )[0]


def draw_trials(
    policy: GraspPolicy, env: GraspEnv, trials: Sequence[Trial], folder: Path, title: str, rows: int = 4
) -> list[Path]:
    """Repeat single-shot trials and draw them, so many rows a picture; give the pictures' paths.

    Args:
        policy: whose trials they were.
        env: with a render mode, and with the camera and phrasings that the trials had.
        trials: what to repeat.
        folder: where `1.png`, `2.png`, ... go.
        title: above each picture.
        rows: queries a picture.
    """
    from equigrasp.pictures import draw

    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for start in range(0, len(trials), rows):
        queries = [ask(policy, env, trial.seed, trial.goal, None) for trial in trials[start : start + rows]]
        paths.append(folder / f"{start // rows + 1}.png")
        draw(queries, paths[-1], title)
    return paths
