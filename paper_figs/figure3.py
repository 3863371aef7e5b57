"""Figure 3, the gallery: a scene of each task under what is said in it, and the parts that the judge knows.

    uv run python paper_figs/figure3.py

draws `figures/figure-3.{png,pdf}` from the simulator; it needs no results.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from equigrasp.artefacts import check_folder
from equigrasp.exits import exits
from equigrasp.workspace import WORKSPACE
from tasks import TASKS
from tasks.above import PART_COLORS, in_parts, photographed
from tasks.env import GraspEnv
from tasks.gallery import BRIGHT, LEGEND, PART_SHADE, around, part_key, ring

COLUMNS = 3
WIDTH, HEIGHT = SIZE = (0.7, 0.4)
"""Of what each picture shows, metres: less than the table, so that small things are seen, and all at one scale."""
MARGIN = 0.015
"""Metres around what lies on the table, and around the ring."""
LETTERS = 42
"""Of a sentence above a picture."""
LOW = 0.004
"""Metres: what is higher stands on the table."""


def draw(seed: int) -> Figure:
    """A picture for each task, in the suite's order, one of the last task's parts, and what the marks mean.

    Args:
        seed: of the first scene that is looked at for a task; drawn is the first one that fits into a picture.
    """
    rows = -(-(len(TASKS) + 2) // COLUMNS)
    figure = Figure(figsize=(9.0, 2.3 * rows), layout="constrained")
    grid = figure.subplots(rows, COLUMNS).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, task in zip(grid, TASKS.values(), strict=False):
        env = GraspEnv(task, camera="overhead")
        try:
            middle = _fitting(env, seed)
            scene(axes, env, middle)
            axes.set_title(f"{task.name}\n\u201c{env.instruction}\u201d", fontsize=9.5)
            if task.name == [*TASKS][-1]:
                names = parts(grid[len(TASKS)], env, middle)
                grid[len(TASKS)].set_title("the same scene\nits parts, as the judge knows them", fontsize=9.5)
        finally:
            env.close()
    _key(grid[-1], names)
    return figure


def _fitting(env: GraspEnv, seed: int) -> NDArray[np.float64]:
    """Reset to the first scene that a picture has room for, and a line for its sentence.

    Returns:
        x and y of the picture's middle, metres.
    """
    for each in itertools.count(seed):
        env.reset(seed=each)
        v, u = np.nonzero(env.observation.height > LOW)
        points = WORKSPACE.to_world(np.stack([u, v], axis=1))
        x, y, radius = around(env.started()[1], env.goal.name)
        low = np.minimum(points.min(axis=0), [x - radius, y - radius]) - MARGIN
        high = np.maximum(points.max(axis=0), [x + radius, y + radius]) + MARGIN
        if (high - low <= SIZE).all() and len(env.instruction) <= LETTERS:
            return (low + high) / 2
    raise AssertionError


def scene(axes: Axes, env: GraspEnv, middle: NDArray[np.float64]) -> None:
    """The table around its objects, the target ringed."""
    _, lying = env.started()
    axes.imshow(photographed(lying, middle, SIZE).shaded(), extent=_extent(middle))
    ring(axes, *around(lying, env.goal.name))


def parts(axes: Axes, env: GraspEnv, middle: NDArray[np.float64]) -> list[str]:
    """The same table, each object's parts in the colours of their names; gives these names."""
    picture, indices = in_parts(env.started()[1], middle, SIZE, BRIGHT)
    axes.imshow(picture.shaded(PART_SHADE), extent=_extent(middle))
    return [name for index, name in enumerate(PART_COLORS) if (indices == index).any()]


def _extent(middle: NDArray[np.float64]) -> tuple[float, float, float, float]:
    x, y = middle
    return x - WIDTH / 2, x + WIDTH / 2, y - HEIGHT / 2, y + HEIGHT / 2


def _key(axes: Axes, names: Sequence[str]) -> None:
    """What ring and bar mean, at the pictures' scale, and the colours of the parts."""
    axes.set_xlim(0, WIDTH)
    axes.set_ylim(0, HEIGHT)
    axes.set_aspect("equal")
    ring(axes, 0.07, 0.34, 0.035)
    axes.plot([0.02, 0.12], [0.255, 0.255], color="black", lw=2.5, solid_capstyle="butt")
    for y, words in ((0.34, "what is asked for"), (0.255, "10 cm, in each picture")):
        axes.text(0.15, y, words, fontsize=10, va="center")
    key = axes.legend(handles=part_key(*names), loc="lower left", ncols=2, **LEGEND | {"fontsize": 9})
    key.set_in_layout(False)


@exits()
def main(chosen: Sequence[str] | None = None) -> None:
    """Draw the gallery."""
    parser = argparse.ArgumentParser(description="Figure 3: a scene of each task.")
    parser.add_argument("--seed", type=int, default=0, help="the first scene that is looked at for each task [0]")
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that the figure is written to")
    options = parser.parse_args(chosen)
    check_folder(options.out, "--out")
    print(*style.save(draw(options.seed), "figure-3", options.out, colors=256), sep="\n")


if __name__ == "__main__":
    main()
