"""What the commands share: progress bars, printing, environments by name."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

from equigrasp.errors import InputError

if TYPE_CHECKING:
    from tasks.env import GraspEnv
    from tasks.task import Task

Camera = Literal["fused", "overhead"]
Phrasings = Literal["seen", "unseen"]


def bar(title: str, unit: str) -> Callable[..., Any]:
    """A progress bar with rate and time left: it wraps what is iterated over; `total`, where that has no length.

    It pickles, for a training that runs in other processes.
    """
    return partial(_bar, title, unit)


def _bar(title: str, unit: str, items: Iterable[Any], total: int | None = None) -> Iterable[Any]:
    from tqdm import tqdm

    return tqdm(items, total=total, desc=f"{title:18}", unit=" " + unit, smoothing=0.05, dynamic_ncols=True)


def say(*lines: str) -> None:
    """Print whole lines at once."""
    print(*lines, sep="\n", flush=True)


def options(**given: object) -> str:
    """Options for a shell, each with a space before it and its value quoted; what is None is left out."""
    said = ((name.replace("_", "-"), value) for name, value in given.items() if value is not None)
    return "".join(f" --{name} {shlex.quote(str(value))}" for name, value in said)


def make_env(
    task: str | Task, camera: Camera, phrasings: Phrasings = "seen", render_mode: Literal["rgb_array"] | None = None
) -> GraspEnv:
    """The environment of a task, by its name or its row; InputError with the nearest names if there is none."""
    from tasks.env import GraspEnv

    return GraspEnv(task, camera=camera, phrasings=phrasings, render_mode=render_mode)


def task_of(
    plan: Mapping[str, Any], asked: str | None, way_out: str = "name one with --task; `equigrasp tasks` lists them"
) -> Task:
    """The task that was asked for, or the one of a run's demonstrations; InputError if the simulator has no such."""
    from tasks import TASKS, find_task

    if asked is None and plan["task"] not in TASKS and ":" not in plan["task"]:
        raise InputError(f"this run was trained on {plan['task']!r}, which is no task of the simulator; {way_out}")
    return find_task(plan["task"] if asked is None else asked)


def camera_of(plan: Mapping[str, Any], asked: Camera | None) -> Camera:
    """The camera that was asked for, or the one of a run's demonstrations; InputError if the simulator has no such."""
    if asked is None and plan["camera"] not in get_args(Camera):
        raise InputError(
            f"this run's demonstrations are of a camera {plan['camera']!r}, which the simulator has not; "
            f"add --camera {' or '.join(get_args(Camera))}"
        )
    return asked or cast(Camera, plan["camera"])


def a_sentence(task: Task, phrasings: Phrasings = "seen") -> str:
    """The first instruction that the task's environment can say."""
    from tasks.instructions import render

    goal = task.goals[0]
    return render(goal, task.grammar(goal).phrasings(phrasings)[0])
