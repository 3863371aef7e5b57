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
        if phase == "lift" and next(steps) % 10 == 9 and (rendering := env.render()) is not None:
            photographs.append(close_up(rendering, grasp))

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


def close_up(photograph: NDArray[np.uint8], grasp: Grasp) -> NDArray[np.uint8]:
    """Cut `(270, 360, 3)` around the lifted hand out of a rendering."""
    import numpy as np

    from equigrasp.workspace import WORKSPACE
    from tasks.camera import portrait_viewpoint
    from tasks.gripper import LIFT

    viewpoint = portrait_viewpoint()
    x, y = WORKSPACE.to_world([grasp.u, grasp.v])
    point = np.linalg.inv(viewpoint.pose) @ [x, y, LIFT, 1.0]
    column, row, depth = viewpoint.intrinsics @ point[:3]
    rows, columns, _ = photograph.shape
    left = int(np.clip(column / depth - 180, 0, columns - 360))
    top = int(np.clip(row / depth - 135, 0, rows - 270))
    return photograph[top : top + 270, left : left + 360]


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
