"""The suite in two pictures: every object from above, and a scene of each task with its instruction (Figure 3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from equigrasp.artefacts import write_figure
from equigrasp.workspace import WORKSPACE, Motion
from tasks import TASKS, camera
from tasks.env import GraspEnv
from tasks.objects import OBJECTS, PAINTS, load, painted
from tasks.scene import Client, Scene

ZOOM = 4
"""Pixels of the gallery for each of a heightmap's, along each axis."""
SIDE = 0.2
"""Of an object's picture, metres."""

Progress = Callable[[Sequence[Any]], Iterable[Any]]


def seen_from_above(scene: Scene, middle: NDArray[np.float64], size: tuple[float, float]) -> NDArray[np.uint8]:
    """The table from straight above, ZOOM times finer than a policy sees it: `(h, w, 3)` uint8.

    Args:
        scene: what lies on it.
        middle: x and y of the picture's middle, metres.
        size: width and height of the picture, metres.
    """
    above = camera.overhead_viewpoint()
    columns, rows = (round(side / WORKSPACE.pixel) * ZOOM for side in size)
    intrinsics = np.array(above.intrinsics)
    intrinsics[:2] *= ZOOM
    x, y = middle / WORKSPACE.pixel * ZOOM
    intrinsics[:2, 2] = (columns - 1) / 2 - x, (rows - 1) / 2 + y
    return camera.shoot(scene.visible(), replace(above, intrinsics=intrinsics, size=(rows, columns)))[0]


def draw_objects(path: Path, progress: Progress = iter) -> None:
    """Draw every object in its own look, and the ten colours, to a PNG or a PDF, by the path's ending."""
    assets = [load(name) for name in OBJECTS if name != "L-block"]
    colored = [painted(load("L-block"), color) for color in PAINTS]
    columns = 12
    first = -(-len(assets) // columns) * columns
    rows = (first + len(colored)) // columns + 1
    figure = Figure(figsize=(1.2 * columns, 1.38 * rows), layout="tight")
    grid = figure.subplots(rows, columns).ravel()
    for axes in grid:
        axes.set_axis_off()
    places = [*range(len(assets)), *range(first, first + len(colored))]
    bullet = Client()
    try:
        for place, asset in progress(list(zip(places, assets + colored, strict=True))):
            scene = Scene(bullet, [asset], [Motion()])
            # a footprint need not be centred on the centre of mass
            middle = 0.5 * (asset.footprint.min(axis=0) + asset.footprint.max(axis=0))
            grid[place].imshow(seen_from_above(scene, middle, (SIDE, SIDE)))
            grid[place].set_title(asset.name.replace("-", " "), fontsize=8, pad=2)
    finally:
        bullet.disconnect()
    write_figure(path, figure, dpi=110)


def draw_tasks(path: Path, seed: int = 0, progress: Progress = iter) -> None:
    """Draw a scene of each task under what is said in it, its target ringed; a PNG or a PDF, by the path."""
    columns = 3
    rows = -(-len(TASKS) // columns)
    figure = Figure(figsize=(4.7 * columns, 2.8 * rows), layout="constrained")
    grid = figure.subplots(rows, columns).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, task in zip(grid, progress(list(TASKS.values())), strict=False):
        env = GraspEnv(task, camera="overhead")
        try:
            env.reset(seed=seed)
            _, scene = env.started()
            axes.imshow(
                seen_from_above(scene, np.zeros(2), (WORKSPACE.length, WORKSPACE.depth)),
                extent=[100 * side for bounds in WORKSPACE.bounds for side in bounds],
            )
            x, y, _ = 100 * scene.pose(env.goal.name).position
            radius = 100 * scene.asset(env.goal.name).radius + 1
            axes.add_patch(Circle((x, y), radius, fill=False, color="#E69F00", lw=2))
            axes.set_title(f"{task.name}\n\u201c{env.instruction}\u201d", fontsize=10.5)
        finally:
            env.close()
    write_figure(path, figure, dpi=110)
