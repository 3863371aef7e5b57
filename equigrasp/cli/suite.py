"""Commands about the suite: what tasks there are, demonstrations of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from equigrasp.cli.common import Camera, bar, make_env, say


@dataclass
class Tasks:
    """List the tasks: goals, objects in a scene, Gymnasium id.

    Example: equigrasp tasks
    """

    def execute(self) -> None:
        """Print them."""
        from tasks import TASKS

        for task in TASKS.values():
            fewest, most = task.objects
            say(f"{task.name:20} {task.env_id:28} {len(task.goals)} goals, {fewest} to {most} objects a scene")
            say(*(f"    {goal}" for goal in task.goals))
        say("next: equigrasp collect --task pick-by-part --demos 1")


@dataclass
class Collect:
    """Let the scripted oracle demonstrate a task in the simulator.

    Example: equigrasp collect --task pick-by-part --demos 1
    """

    task: str = "pick-by-part"
    """Name of the task; `equigrasp tasks` lists them."""
    demos: int = 1
    """How many demonstrations; each is one grasp for every goal of the task (23 for pick-by-part)."""
    camera: Camera = "fused"
    """Three fused RGB-D cameras, as in the paper, or one overhead (several times faster)."""
    seed: int = 0
    """Which scenes, from 0 to 999."""
    out: Path | None = None
    """The data folder [default: data/TASK-DEMOSdemos-seedSEED]."""

    def execute(self) -> Path:
        """Collect, and give the folder."""
        from equigrasp.demonstrations import Collection, collect
        from tasks import find_task

        task = find_task(self.task)
        out = self.out or Path("data") / f"{self.task}-{self.demos}demos-seed{self.seed}"
        goals = len(task.goals)
        collection = Collection(self.task, goals, self.demos, self.seed, self.camera)
        env = make_env(self.task, self.camera)
        try:
            collect(collection, env, out, bar("collect", "grasps"))
        finally:
            env.close()
        say(f"{self.demos * goals} grasps of {self.task} lie in {out}", f"next: equigrasp train --data {out}")
        return out
