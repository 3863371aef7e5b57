"""Figure 3, the gallery: a scene of each task under what is said in it, and the parts that the judge knows.

    uv run python paper_figs/figure3.py

draws `figures/figure-3.{png,pdf}` from the simulator; it needs no results.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from equigrasp.artefacts import check_folder
from equigrasp.exits import exits
from equigrasp.workspace import WORKSPACE
from tasks import TASKS, camera
from tasks.env import GraspEnv
from tasks.gallery import seen_from_above

COLUMNS, ASPECT = 3, 1.75
MARGIN = 0.02
"""Metres around what lies on the table."""
LOW = 0.004
"""Metres: what is higher stands on the table."""
SMALLEST = 0.22
"""Height of the smallest window, metres, so that a few small things do not fill a picture."""
TABLE = (*WORKSPACE.bounds[0], *WORKSPACE.bounds[1])
"""Left, right, bottom and top of the table, metres."""
PARTS = (style.YELLOW, style.SKY, style.PINK)
"""Of an object's first, second and third part."""


def draw(seed: int) -> Figure:
    """A picture for each task, in the suite's order, and one of the last task's parts."""
    rows = -(-(len(TASKS) + 1) // COLUMNS)
    figure = Figure(figsize=(9.0, 2.2 * rows), layout="constrained")
    grid = figure.subplots(rows, COLUMNS).ravel()
    for axes in grid:
        axes.set_axis_off()
    for index, (axes, task) in enumerate(zip(grid, TASKS.values(), strict=False)):
        env = GraspEnv(task, camera="overhead")
        try:
            env.reset(seed=seed)
            window = scene(axes, env)
            axes.set_title(_title(task.name, f"\u201c{env.instruction}\u201d"), fontsize=9)
            if index == len(TASKS) - 1:
                parts(grid[index + 1], env, window)
                grid[index + 1].set_title(_title("the same scene", "its parts, as the judge knows them"), fontsize=9)
        finally:
            env.close()
    grid[-1].text(
        0.02,
        0.5,
        "Ring: what is asked for.\nBar: 10 cm.\n\nA scene has 4 or 5 objects; each\nis asked for once.",
        fontsize=9,
        va="center",
        linespacing=1.4,
        transform=grid[-1].transAxes,
    )
    return figure


def scene(axes: Axes, env: GraspEnv) -> tuple[float, float, float, float]:
    """The table around its objects, the target ringed; gives left, right, bottom and top in metres."""
    _, lying = env.started()
    left, right, bottom, top = window = _window(env)
    middle, size = np.array([left + right, bottom + top]) / 2, (right - left, top - bottom)
    axes.imshow(seen_from_above(lying, middle, size), extent=window)
    x, y, _ = lying.pose(env.goal.name).position
    axes.add_patch(Circle((x, y), lying.asset(env.goal.name).radius + 0.01, fill=False, color=style.YELLOW, lw=1.8))
    _frame(axes, env, window)
    return window


def parts(axes: Axes, env: GraspEnv, window: tuple[float, float, float, float]) -> None:
    """The same table in grey, every object's parts in colours, the target's by name."""
    _, lying = env.started()
    left, right, bottom, top = window
    middle, size = np.array([left + right, bottom + top]) / 2, (right - left, top - bottom)
    grey = seen_from_above(lying, middle, size).mean(axis=2)
    axes.imshow(grey, extent=window, cmap="gray", vmin=0, vmax=255)
    observation, bodies = camera.overhead(lying.visible())
    for name, body in lying.bodies.items():
        v, u = np.nonzero(bodies == body)
        points = np.column_stack([WORKSPACE.to_world(np.stack([u, v], axis=1)), observation.height[v, u].astype(float)])
        index = lying.parts_at(name, points)
        shown = np.zeros((*WORKSPACE.shape, 4))
        for part, color in enumerate(PARTS):
            shown[v[index == part], u[index == part]] = _rgba(color)
        axes.imshow(shown, extent=TABLE, interpolation="nearest")
        if name == env.goal.name:
            _names(axes, lying.asset(name).parts, points, index)
    _frame(axes, env, window)


def _names(axes: Axes, names: Sequence[str], points: NDArray[np.float64], index: NDArray[np.int64]) -> None:
    centre = points[:, :2].mean(axis=0)
    for part, name in enumerate(names):
        if not (index == part).any():
            continue
        away = points[index == part, :2].mean(axis=0) - centre
        away /= max(float(np.hypot(*away)), 1e-6)
        reach = float(((points[index == part, :2] - centre) @ away).max())
        side = "right" if away[0] < -0.5 else "left" if away[0] > 0.5 else "center"
        x, y = centre + (reach + 0.012) * away
        axes.text(x, y, name, color="white", fontsize=9, ha=side, va="center", fontweight="bold")


def _rgba(color: str) -> tuple[float, float, float, float]:
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue, 0.85


def _window(env: GraspEnv) -> tuple[float, float, float, float]:
    v, u = np.nonzero(env.observation.height > LOW)
    x, y = WORKSPACE.to_world(np.stack([u, v], axis=1)).T
    high = max(np.ptp(y) + 2 * MARGIN, (np.ptp(x) + 2 * MARGIN) / ASPECT, SMALLEST)
    # whole pixels, which is what a picture of the gallery has
    high = WORKSPACE.pixel * 4 * np.ceil(high / WORKSPACE.pixel / 4)
    middle_x, middle_y = (x.min() + x.max()) / 2, (y.min() + y.max()) / 2
    return middle_x - ASPECT * high / 2, middle_x + ASPECT * high / 2, middle_y - high / 2, middle_y + high / 2


def _frame(axes: Axes, env: GraspEnv, window: tuple[float, float, float, float]) -> None:
    """Cut to the window, and a bar of 10 cm in the first corner where nothing lies."""
    left, right, bottom, top = window
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    inset = 0.05 * (top - bottom)
    corners = [(x, y) for y in (bottom + inset, top - inset) for x in (left + inset, right - inset - 0.1)]

    def taken(corner: tuple[float, float]) -> float:
        u, v = WORKSPACE.to_pixel([[corner[0] - 0.01, corner[1] + 0.02], [corner[0] + 0.11, corner[1] - 0.02]]).T
        rows, columns = (np.clip(each, 0, None).astype(int) for each in (v, u))
        return float(env.observation.height[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1].max(initial=0))

    x, y = min(corners, key=lambda corner: taken(corner) > LOW)
    axes.plot([x, x + 0.1], [y, y], color="white", lw=2, solid_capstyle="butt")


def _title(name: str, sentence: str) -> str:
    return "\n".join([name, *textwrap.wrap(sentence, 46)])


@exits()
def main(chosen: Sequence[str] | None = None) -> None:
    """Draw the gallery."""
    parser = argparse.ArgumentParser(description="Figure 3: a scene of each task.")
    parser.add_argument("--seed", type=int, default=0, help="which scenes [0]")
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that the figure is written to")
    options = parser.parse_args(chosen)
    check_folder(options.out, "--out")
    print(*style.save(draw(options.seed), "figure-3", options.out, colors=256), sep="\n")


if __name__ == "__main__":
    main()
