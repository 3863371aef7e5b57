"""The benchmark: tasks of language-conditioned grasping in PyBullet, as Gymnasium environments.

Importing this registers them, so that `gymnasium.make("equigrasp/PickByPart-v0")` works. The import itself
starts no simulator.
"""

from __future__ import annotations

import gymnasium

from equigrasp.errors import InputError, unknown
from equigrasp.naming import attribute
from tasks.combinations import FRUIT, TOOLS, TOYS, combinations, held_out
from tasks.goal import Goal
from tasks.objects import CAPTIONS, LOGOS, PAINTS
from tasks.task import Task, by_part, each_of

_ELLS = tuple(Goal("L-block", color=color) for color in PAINTS)
_CAPTIONED = each_of((f"bottle-{letter}" for letter in CAPTIONS), kind="caption")
_WITH_LOGO = each_of((f"block-{logo}" for logo in LOGOS), kind="logo")

_ROWS = [
    Task("pick-colored-ell", "equigrasp/PickColoredEll-v0", _ELLS, "an L-shaped block of a colour"),
    Task("pick-fruit", "equigrasp/PickFruit-v0", each_of(FRUIT), "a fruit"),
    Task("pick-tool", "equigrasp/PickTool-v0", each_of(TOOLS), "a tool"),
    Task("pick-toy", "equigrasp/PickToy-v0", each_of(TOYS), "a toy animal"),
    Task("pick-caption", "equigrasp/PickCaption-v0", _CAPTIONED, "a bottle by the letter on its cap"),
    Task("pick-logo", "equigrasp/PickLogo-v0", _WITH_LOGO, "a block by its logo"),
    Task(
        name="pick-random-v1",
        env_id="equigrasp/PickRandomV1-v0",
        goals=(*_ELLS, *each_of((*FRUIT, *TOOLS, *TOYS)), *_CAPTIONED, *_WITH_LOGO),
        summary="anything of the six tasks above",
        objects=(5, 5),
        repeated=1,
    ),
    Task(
        name="pick-colored-fruit",
        env_id="equigrasp/PickColoredFruit-v0",
        goals=combinations(FRUIT),
        summary="a fruit of a colour",
        demonstrated="object",
    ),
    Task(
        name="pick-colored-tool",
        env_id="equigrasp/PickColoredTool-v0",
        goals=combinations(TOOLS),
        summary="a tool of a colour",
        demonstrated="object",
    ),
    Task(
        name="pick-colored-toy",
        env_id="equigrasp/PickColoredToy-v0",
        goals=combinations(TOYS),
        summary="a toy animal of a colour",
        demonstrated="object",
    ),
    Task(
        name="pick-random-v2",
        env_id="equigrasp/PickRandomV2-v0",
        goals=combinations((*FRUIT, *TOOLS, *TOYS)),
        summary="anything of the three tasks above",
        objects=(5, 5),
        demonstrated="object",
    ),
    Task(
        name="pick-novel-v2",
        env_id="equigrasp/PickNovelV2-v0",
        goals=held_out(),
        summary="shape and colour in a combination that was never trained on",
        objects=(5, 5),
        trains=False,
    ),
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
        summary="an object by one of its parts",
    ),
]

TASKS: dict[str, Task] = {task.name: task for task in _ROWS}
"""Every task by its name. A new one is a row above: its goals, and how one speaks of them."""


def find_task(name: str) -> Task:
    """The task of this name, or the row of your own that "my_package.my_module:MY_TASK" names, checked.

    Raises:
        InputError: if there is none; it names the nearest, or what is wrong with the row.
    """
    task = find_row(name)
    if ":" in name:
        task.check()
    return task


def find_row(name: str) -> Task:
    """As `find_task`, but of a row of your own no object is loaded yet, so that none is baked.

    Raises:
        InputError: if there is none; it names the nearest.
    """
    if ":" in name:
        task = attribute(name, "a task", "MY_TASK")
        if not isinstance(task, Task):
            raise InputError(f"{name} is a {type(task).__name__}, but it must be a tasks.task.Task")
        return task
    if name not in TASKS:
        raise unknown("task", name, TASKS)
    return TASKS[name]


for _task in TASKS.values():
    gymnasium.register(id=_task.env_id, entry_point="tasks.env:GraspEnv", kwargs={"task": _task.name})

__all__ = ["TASKS", "Goal", "Task", "find_row", "find_task"]
