"""The command that makes of a run one file for a robot that has neither equigrasp nor escnn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from equigrasp.cli.common import Camera, a_sentence, make_env, say
from equigrasp.errors import InputError

if TYPE_CHECKING:
    from equigrasp.grasp import Observation
    from equigrasp.policy import GraspPolicy

TEST_SCENES = 3
"""Scenes of its task on which the file is compared with the policy."""


@dataclass
class Export:
    """Write a trained policy as one program, of torch.export (.pt2) or ONNX (.onnx), and say how well it agrees.

    It takes an observation and an instruction's embedding, and gives the log-probabilities (`docs/export.md`). The two
    are compared on scenes of noise, and on test scenes of the task that the policy was trained on, if it is the
    suite's.

    Example: equigrasp export --run runs/my-run --out my-policy.onnx
    """

    run: Path
    """A run folder that `equigrasp train` made, or a folder of `equigrasp share`."""
    out: Path
    """The new file; its name says the format, .pt2 or .onnx."""
    step: int | None = None
    """A step whose weights were kept [default: the last]."""

    def execute(self) -> None:
        """Check, export, compare, write."""
        from equigrasp.artefacts import check_folder

        if self.out.suffix not in (".pt2", ".onnx"):
            raise InputError(f"--out is {self.out}, but its name must end in .pt2 or .onnx, which says the format")
        if self.out.exists():
            raise InputError(f"{self.out} exists; choose another --out")
        check_folder(self.out.parent, "--out")
        from equigrasp.plan import find_weights, read_plan

        plan = read_plan(self.run)
        find_weights(self.run, self.step)
        from equigrasp.export import SCENES, export, writer
        from equigrasp.training import load_policy

        writer(self.out)
        policy = load_policy(self.run, self.step)
        seen = _test_scenes(policy, plan)
        agreement = export(policy, self.out, seen=seen)
        scenes = f"{SCENES} scenes of noise" + (f" and {len(seen)} of {plan['task']}" if seen else "")
        say(
            f"{self.out} has the policy, {self.out.stat().st_size / 1e6:.1f} MB",
            f"on {scenes} its log-probabilities are within {agreement.largest:.1e} of the policy's own, "
            f"which spread over {agreement.spread:.2g}",
        )


def _test_scenes(policy: GraspPolicy, plan: Mapping[str, Any]) -> list[tuple[Observation, str]]:
    """What the first test scenes of the run's task show and ask; none of a task or camera that the suite has not."""
    from equigrasp.evaluation import scene_at
    from tasks import TASKS

    if plan["task"] not in TASKS or plan["camera"] not in get_args(Camera):
        return []
    task = TASKS[plan["task"]]
    try:
        policy.embed(a_sentence(task))
    except InputError:  # an encoder whose weights are elsewhere; the file takes embeddings
        return []
    env = make_env(task, plan["camera"])
    found = []
    try:
        for place in range(TEST_SCENES):
            env.reset(seed=scene_at(place))
            found.append((env.observation, env.instruction))
    finally:
        env.close()
    return found
