"""The suite in two pictures: every object from above, and a scene of each task with its instruction (Figure 3)."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from equigrasp.workspace import WORKSPACE, Motion
from tasks import TASKS, camera
from tasks.env import GraspEnv
from tasks.objects import OBJECTS, PAINTS, ObjectAsset, load, painted
from tasks.scene import Client, Scene

ZOOM = 5
"""Pixels of the gallery for each of a heightmap's, along each axis."""
SIDE = 0.2
"""Of an object's picture, metres."""

Progress = Callable[[Sequence[Any]], Iterable[Any]]


def close_up(bullet: Client, asset: ObjectAsset, zoom: int = ZOOM) -> NDArray[np.uint8]:
    """An object alone on the table, from straight above: `(h, w, 3)` uint8, SIDE metres wide.

    Args:
        bullet: a client, which is reset.
        asset: the object.
        zoom: 1 shows the pixels that a policy sees, at 3.125 mm.
    """
    Scene(bullet, [asset], [Motion()])
    pixels = round(SIDE / WORKSPACE.pixel) * zoom
    above = camera.overhead_viewpoint()
    intrinsics = np.array(above.intrinsics)
    intrinsics[:2] *= zoom
    # a footprint need not be centred on the centre of mass
    low, high = asset.footprint.min(axis=0), asset.footprint.max(axis=0)
    middle = np.array([0.5, -0.5]) * (low + high) / WORKSPACE.pixel * zoom
    intrinsics[:2, 2] = (pixels - 1) / 2 - middle
    return camera.shoot(bullet, replace(above, intrinsics=intrinsics, size=(pixels, pixels)))[0]


def draw_objects(path: Path, progress: Progress = iter) -> None:
    """Draw every object in its own look, and the ten colours, to a PNG or a PDF, by the path's ending."""
    assets = [load(name) for name in OBJECTS if name != "L-block"]
    assets += [painted(load("L-block"), color) for color in PAINTS]
    columns = 9
    rows = -(-len(assets) // columns)
    figure = Figure(figsize=(1.35 * columns, 1.5 * rows), layout="tight")
    grid = figure.subplots(rows, columns)
    for axes in grid.flat:
        axes.set_axis_off()
    bullet = Client()
    try:
        for axes, asset in zip(grid.flat, progress(assets), strict=False):
            axes.imshow(close_up(bullet, asset), interpolation="antialiased")
            axes.set_title(asset.name.replace("-", " "), fontsize=8.5, pad=2)
    finally:
        bullet.disconnect()
    figure.savefig(path, dpi=110)


def draw_tasks(path: Path, seed: int = 0, progress: Progress = iter) -> None:
    """Draw a scene of each task under what is said in it, to a PNG or a PDF, by the path's ending."""
    columns = 4
    rows = -(-len(TASKS) // columns)
    figure = Figure(figsize=(13.2, 3.3 * rows), layout="constrained")
    grid = figure.subplots(rows, columns)
    for axes in grid.flat:
        axes.set_axis_off()
    for axes, task in zip(grid.flat, progress(list(TASKS.values())), strict=False):
        env = GraspEnv(task, camera="overhead", render_mode="rgb_array")
        try:
            env.reset(seed=seed)
            picture = env.render()
            assert picture is not None
            axes.imshow(picture[80:420])
            sentence = "\n".join(textwrap.wrap(f"\u201c{env.instruction}\u201d", 44))
        finally:
            env.close()
        axes.set_title(f"$\\bf{{{task.name}}}$\n{sentence}", fontsize=9.5)
    figure.savefig(path, dpi=110)
