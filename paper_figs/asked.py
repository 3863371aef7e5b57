"""One question to a trained policy in the simulator, with every tensor on the way: what Figures 1 and 2 draw."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from numpy.typing import NDArray

from equigrasp.errors import InputError
from equigrasp.grasp import Grasp, Observation
from equigrasp.hand import HAND
from equigrasp.plan import read_plan
from equigrasp.policy import LegPolicy, to_tensor
from equigrasp.training import load_policy
from equigrasp.workspace import WORKSPACE
from tasks.above import seen_from_above
from tasks.env import GraspEnv

OPENING, FINGER = 100 * HAND.opening, 1.1
"""Between the open fingertips, and half of a finger's width, centimetres: the hand is drawn to scale."""
HOW = "uv run equigrasp quickstart --steps 2000"
"""What makes the run that the figures are drawn from by default."""
RUN = Path("quickstart/run")
(_LEFT, _RIGHT), (_BOTTOM, _TOP) = WORKSPACE.bounds
TABLE = (100 * _LEFT, 100 * _RIGHT, 100 * _BOTTOM, 100 * _TOP)
"""Left, right, bottom and top of the table, centimetres."""


@dataclass(frozen=True, eq=False)
class Asked:
    """A scene, an instruction, and all that the policy made of them.

    Attributes:
        observation: what the policy saw.
        photograph: `(4 H, 4 W, 3)` uint8, the same from above, finer than a policy sees it.
        target: x and y of the goal object's centre of mass, metres.
        instruction: what was said.
        embedding: `(D,)`, the instruction's.
        features: `(C, h, w)`, phi(o, l).
        kernel: `(O, C, k, k)`, kappa(l) in even irreps.
        field: `(O, h, w)`, the correlation, in even irreps.
        log_probabilities: `(36, h, w)`, natural logarithms.
        grasp: the best one.
        success: whether it did what was asked, tried in the simulator.
    """

    observation: Observation
    photograph: NDArray[np.uint8]
    target: tuple[float, float]
    instruction: str
    embedding: NDArray[np.float32]
    features: NDArray[np.float32]
    kernel: NDArray[np.float32]
    field: NDArray[np.float32]
    log_probabilities: NDArray[np.float32]
    grasp: Grasp
    success: bool

    @property
    def best(self) -> tuple[int, int, int]:
        """Bin, row and column of the highest score."""
        index = np.unravel_index(int(self.log_probabilities.argmax()), self.log_probabilities.shape)
        bin_, row, column = (int(each) for each in index)
        return bin_, row, column


@torch.no_grad()
def ask(policy: LegPolicy, env: GraspEnv) -> Asked:
    """Ask for a grasp in the scene as it is, and try it there; the scene is not the same afterwards."""
    observation, instruction = env.observation, env.instruction
    _, scene = env.started()
    x, y, _ = scene.pose(env.goal.name).position
    photograph = seen_from_above(scene, np.zeros(2), (WORKSPACE.length, WORKSPACE.depth))
    image, embedding = to_tensor(observation)[None], policy.embed(instruction)[None]
    grasp = policy.act(observation, instruction)
    return Asked(
        observation=observation,
        photograph=photograph,
        target=(float(x), float(y)),
        instruction=instruction,
        embedding=embedding[0].numpy(),
        features=policy.phi(image, embedding)[0].float().numpy(),
        kernel=policy.kappa(embedding)[0].float().numpy(),
        field=policy.field(image, embedding)[0].numpy(),
        log_probabilities=policy.log_probabilities(image, embedding)[0].numpy(),
        grasp=grasp,
        success=bool(env.attempt(grasp).success),
    )


def load(run: Path) -> tuple[LegPolicy, GraspEnv, str]:
    """The policy of a run, an environment of its task and camera, and in a few words what the run was.

    Raises:
        InputError: if there is no run, or its policy has no phi and kappa to draw.
    """
    if not run.is_dir():
        raise InputError(f"there is no run {run}; `{HOW}` makes one in {RUN}, and --run names any other")
    plan = read_plan(run)
    policy = load_policy(run)
    if not isinstance(policy, LegPolicy):
        raise InputError(
            f"{run} holds a {plan['model']['name']}, which has no kernel to draw; train leg-steerable, leg-equivariant "
            "or leg-unet"
        )
    several = "demonstration" if plan["demos"] == 1 else "demonstrations"
    words = f"{plan['model']['name']}, {plan['demos']} {several}, {plan['training']['steps']:,} training steps"
    return policy, GraspEnv(plan["task"], camera=plan["camera"]), words


def kernel_at(policy: LegPolicy, kernel: NDArray[np.float32], index: int) -> NDArray[np.float32]:
    """The kernel that scores angle bin `index`: `(O, C, k, k)` in even irreps -> `(C, k, k)`."""
    return np.einsum("o,ochw->chw", policy.synthesis.value[index].float().numpy(), kernel)


def hand(axes: Axes, grasp: Grasp, color: str, zorder: float = 5) -> None:
    """Draw the open hand to scale on axes in centimetres: its fingers, and the line along which they close."""
    line, *fingers = _strokes(grasp, FINGER)
    axes.plot(*line, color=color, lw=1.3, zorder=zorder)
    for finger in fingers:
        axes.plot(*finger, color=color, lw=3.2, zorder=zorder, solid_capstyle="butt")


def ghost(axes: Axes, grasp: Grasp, color: str, style: str, zorder: float = 6) -> None:
    """Draw a hand that is not there: thin, its fingers twice as wide, so that it is seen where it lies on another."""
    for stroke in _strokes(grasp, 2 * FINGER):
        axes.plot(*stroke, style, color=color, lw=1.1, zorder=zorder)


def _strokes(grasp: Grasp, finger: float) -> list[tuple[list[float], list[float]]]:
    x, y = 100 * WORKSPACE.to_world([grasp.u, grasp.v])
    c, s = math.cos(grasp.theta), math.sin(grasp.theta)
    half = OPENING / 2
    strokes = [([x - half * c, x + half * c], [y - half * s, y + half * s])]
    for side in (-half, half):
        across = [x + side * c - finger * s, x + side * c + finger * s]
        along = [y + side * s + finger * c, y + side * s - finger * c]
        strokes.append((across, along))
    return strokes


def arguments(description: str, seed: int, goal: int) -> argparse.ArgumentParser:
    """The options that both figures have."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--run", type=Path, default=RUN, help=f"a run folder; `{HOW}` makes {RUN}")
    parser.add_argument("--seed", type=int, default=seed, help=f"which scene [{seed}]")
    parser.add_argument(
        "--goal", type=int, default=goal, help=f"index of the goal, as `equigrasp tasks` lists them [{goal}]"
    )
    return parser
