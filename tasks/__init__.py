"""The benchmark: tasks of language-conditioned grasping in PyBullet, as Gymnasium environments.

Importing this registers them, so that `gymnasium.make("equigrasp/PickByPart-v0")` works. The import itself
starts no simulator.
"""

from __future__ import annotations

import gymnasium

from equigrasp.errors import unknown
from tasks.task import Goal, Task, by_part

_ROWS = [
    Task(
        name="pick-by-part",
        env_id="equigrasp/PickByPart-v0",
        goals=by_part(
            {
                "fork": ("head", "middle", "end"),
                "knife": ("head", "middle", "end"),
                "spoon": ("head", "middle", "end"),
                "medium-clamp": ("head", "handle"),
                "mini-claw-hammer": ("head", "handle"),
                "mug": ("brim", "handle"),
                "scissors": ("handle", "middle"),
                "lion": ("head", "body"),
                "hippo": ("head", "body"),
                "rhino": ("head", "body"),
            }
        ),
        phrasing="by part",
    ),
]

TASKS: dict[str, Task] = {task.name: task for task in _ROWS}
"""Every task by its name. A new one is a row above: its goals, and how one speaks of them."""


def find_task(name: str) -> Task:
    """The task of this name.

    Raises:
        InputError: if there is none; it names the nearest.
    """
    if name not in TASKS:
        raise unknown("task", name, TASKS)
    return TASKS[name]


for _task in TASKS.values():
    gymnasium.register(id=_task.env_id, entry_point="tasks.env:GraspEnv", kwargs={"task": _task.name})

__all__ = ["TASKS", "Goal", "Task", "find_task"]
