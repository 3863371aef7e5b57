"""Commands about the suite: what tasks there are, demonstrations of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

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
    """Let the scripted oracle demonstrate a task in the simulator; the same command goes on with a stopped one.

    The files are the same whatever the engine and however many workers.

    Example: equigrasp collect --task pick-by-part --demos 10 --workers 4
    """

    task: str = "pick-by-part"
    """Name of the task; `equigrasp tasks` lists them."""
    demos: int = 1
    """How many demonstrations; of most tasks, each is one grasp for every goal (23 for pick-by-part)."""
    camera: Camera = "fused"
    """Three fused RGB-D cameras, as in the paper, or one overhead (several times faster)."""
    seed: int = 0
    """Which scenes, from 0 to 999."""
    out: Path | None = None
    """The data folder [default: data/TASK-DEMOSdemos-seedSEED]."""
    engine: Literal["local", "ray"] = "local"
    """Processes of this machine, or a Ray cluster (needs `equigrasp[ray]`)."""
    workers: int | None = None
    """Grasps at the same time [default: 1; on Ray, one for each CPU]."""
    address: str | None = None
    """HOST:PORT of a Ray cluster that this machine is a node of [default: start one here]."""

    def execute(self) -> Path:
        """Collect, and give the folder."""
        from equigrasp.collection import Collection, draw_goals
        from equigrasp.demonstrations import collect
        from equigrasp.engines import ENGINES
        from tasks import find_task

        task = find_task(self.task)
        engine = ENGINES[self.engine](self.workers, self.address)
        goals = draw_goals(task.demonstration_goals, self.demos, self.seed)
        collection = Collection(task.name, goals, self.seed, self.camera)
        out = self.out or Path("data") / f"{task.name}-{self.demos}demos-seed{self.seed}"
        collect(collection, partial(make_env, task.name, self.camera), out, engine, bar("collect", "grasps"))
        say(f"{len(collection.grasps())} grasps of {task.name} lie in {out}", f"next: equigrasp train --data {out}")
        return out
