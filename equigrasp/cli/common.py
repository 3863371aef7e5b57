"""What the commands share: progress bars, printing, environments by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Literal

from equigrasp.errors import unknown

if TYPE_CHECKING:
    from tasks.env import GraspEnv
    from tasks.task import Task

Camera = Literal["fused", "overhead"]
Phrasings = Literal["seen", "unseen"]


def bar(title: str, unit: str) -> Callable[[Any], Any]:
    """A progress bar with rate and time left, as a wrapper of what is iterated over."""
    from tqdm import tqdm

    def wrap(items: Iterable[Any]) -> Iterable[Any]:
        return tqdm(items, desc=f"{title:18}", unit=" " + unit, smoothing=0.05, dynamic_ncols=True)

    return wrap


def say(*lines: str) -> None:
    """Print whole lines at once."""
    print(*lines, sep="\n", flush=True)


def find_task(name: str) -> Task:
    """The task of that name; InputError with the nearest names if there is none."""
    from tasks import TASKS

    if name not in TASKS:
        raise unknown("task", name, TASKS)
    return TASKS[name]


def make_env(
    task: str, camera: Camera, phrasings: Phrasings = "seen", render_mode: Literal["rgb_array"] | None = None
) -> GraspEnv:
    """The environment of a task."""
    from tasks.env import GraspEnv

    return GraspEnv(find_task(task), camera=camera, phrasings=phrasings, render_mode=render_mode)
