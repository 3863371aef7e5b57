"""Commands about the suite: what tasks there are, demonstrations of them."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from equigrasp.cli.common import Camera, bar, make_env, options, say
from equigrasp.errors import InputError


@dataclass
class Tasks:
    """List the tasks, or one task's goals; or draw every object, what parts have names, and a scene of each task.

    Example: equigrasp tasks --task pick-by-part
    """

    task: str | None = None
    """List the goals of this task, by index."""
    gallery: Path | None = None
    """Draw `objects.png`, `parts.png` and `tasks.png` into this folder."""

    def execute(self) -> None:
        """Print or draw them."""
        from tasks import TASKS, find_task

        chosen = [*TASKS.values()] if self.task is None else [find_task(self.task)]
        if self.gallery is not None:
            if self.task is not None:
                raise InputError(f"--gallery draws every task, and --task is {self.task}; leave one of them out")
            self._draw(self.gallery)
            return
        for task in chosen:
            fewest, most = task.objects
            count = str(fewest) if fewest == most else f"{fewest} to {most}"
            say(f"{task.name:19} {task.env_id:30} {len(task.goals):3} goals, {count:6} objects a scene: {task.summary}")
            if self.task is not None:
                say(*(f"    {index:3} {goal}" for index, goal in enumerate(task.goals)))
        # of a task for testing alone nothing is collected
        shown = self.task if self.task is not None and chosen[0].trains else "pick-by-part"
        say(f"next: equigrasp collect{options(task=shown, demos=1)}")

    def _draw(self, folder: Path) -> None:
        from equigrasp.artefacts import check_folder, check_writable

        check_folder(folder, "--gallery")
        if folder.exists():
            for name in ("objects", "parts", "tasks"):
                check_writable(folder / f"{name}.png", "--gallery")
        from tasks.gallery import draw_objects, draw_parts, draw_tasks

        folder.mkdir(parents=True, exist_ok=True)
        for name, draw in (("objects", draw_objects), ("parts", draw_parts), ("tasks", draw_tasks)):
            draw(folder / f"{name}.png", progress=bar(name, "pictures"))
            say(f"the picture is {folder / name}.png")


@dataclass
class Collect:
    """Let the scripted oracle demonstrate a task in the simulator; the same command goes on with a stopped one.

    The files are the same whatever the engine and however many workers.

    Example: equigrasp collect --task pick-by-part --demos 10 --workers 4
    """

    task: str = "pick-by-part"
    """Name of the task; `equigrasp tasks` lists them; or my_package.my_module:MY_TASK."""
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
        row = task.fingerprint() if ":" in self.task else None
        collection = Collection(self.task, goals, self.seed, self.camera, row)
        out = self.out or Path("data") / f"{task.name}-{self.demos}demos-seed{self.seed}"
        collect(collection, partial(make_env, self.task, self.camera), out, engine, bar("collect", "grasps"))
        data = shlex.quote(str(out))
        say(f"{len(collection.grasps())} grasps of {task.name} lie in {out}", f"next: equigrasp train --data {data}")
        return out
