"""Whether an object can be played with: it fits on the table, stands as it was put, and the hand can hold it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from equigrasp.errors import InputError
from equigrasp.workspace import WORKSPACE
from tasks.meshes.solid import Samples

LARGEST = 0.45
"""Metres: the workspace is 0.5 m deep, and an object has to fit in whichever way it is turned."""
HIGHEST = 0.3
"""Metres: the cameras around the table hang at 0.75 m, and of what is higher they miss the top near its corners."""
SMALLEST = 0.010
THINNEST = 0.0015
TILT = 5.0
"""Degrees that an object may lean over while it settles."""
HOLD = 0.2
"""The oracle's score below which it expects little of a grasp."""


def check_size(extents: NDArray[np.float64], scale: float, what: str) -> None:
    """Refuse what is too large, too small or flat, with the scale that would fit.

    Args:
        extents: `(3,)` metres.
        scale: that it was scaled by.
        what: names it.
    """
    size = " x ".join(f"{extent:.3g}" for extent in extents)
    longest = float(extents.max())
    if not math.isfinite(longest) or longest == 0.0:
        raise InputError(f"{what} is {size} m in size; export it again")
    fitting = [factor for factor in (0.001, 0.01, 0.0254, 0.1, 10.0, 1000.0) if 0.03 <= longest * factor <= 0.35]
    units = {0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches"}
    factor = fitting[0] if fitting else 0.12 / longest
    way = f"pass scale={scale * factor:.3g}" + (f" if it is in {units[factor]}" if factor in units else "")
    if longest > LARGEST:
        raise InputError(f"{what} is {size} m in size, and {LARGEST} m is the most that fits on the table; {way}")
    if longest < SMALLEST:
        raise InputError(f"{what} is {size} m in size, too small to be grasped; {way}")
    if float(extents.min()) < THINNEST:
        raise InputError(f"{what} is flat: {size} m, and {1000 * THINNEST} mm is the least; give it thickness")


def check_height(height: float, what: str) -> None:
    """Refuse what stands so high, in metres, that the cameras around the table do not see its top; `what` names it."""
    if height > HIGHEST:
        raise InputError(
            f"{what} is {height:.3g} m high in this pose, and the cameras around the table see up to {HIGHEST} m; pass "
            "another up, pose='rest' or a smaller scale"
        )


def check_stands(hulls: Path, rest_height: float, settings: dict[str, Any]) -> None:
    """Refuse what falls over in its pose: what lies on a table in a scene should lie as it was said to."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0, 0, -9.81, client)
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        pybullet.createMultiBody(0, plane, physicsClientId=client)
        shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(hulls), physicsClientId=client)
        body = pybullet.createMultiBody(settings["mass"], shape, -1, [0, 0, rest_height], physicsClientId=client)
        for _ in range(480):
            pybullet.stepSimulation(client)
        _, turn = pybullet.getBasePositionAndOrientation(body, client)
        tilt = math.degrees(math.acos(min(1.0, max(-1.0, pybullet.getMatrixFromQuaternion(turn)[8]))))
    finally:
        pybullet.disconnect(client)
    if not tilt < TILT:
        pose = "another up" if settings["pose"] == "rest" else "pose='rest' or another up"
        raise InputError(f"{Path(settings['file']).name} does not stand with {settings['up']} up; pass {pose}")


def check_graspable(samples: Samples, what: str) -> None:
    """Refuse what the hand can close on nowhere; the oracle looks for the best grasp of the object alone."""
    from tasks.oracle import FREE, GOAL, Truth, best_grasps

    counts = np.array(samples.distances.shape)
    tops = np.where(samples.distances < 0, np.arange(1, counts[2] + 1), 0).max(axis=2)
    u, v = np.meshgrid(np.arange(WORKSPACE.columns), np.arange(WORKSPACE.rows))
    index = np.round((WORKSPACE.to_world(np.stack([u, v], axis=-1)) - samples.low[:2]) / samples.step).astype(np.int64)
    within = ((index >= 0) & (index < counts[:2])).all(axis=-1)
    index[~within] = 0
    top = np.where(within, tops[index[..., 0], index[..., 1]], 0)
    height = np.where(top > 0, samples.low[2] + (top - 0.5) * samples.step, 0.0).astype(np.float32)
    owner = np.where(top > 0, GOAL, FREE).astype(np.int8)
    [(_, score)] = best_grasps(Truth(height, owner, top > 0, (0.0, 0.0)))
    if score < HOLD:
        raise InputError(
            f"{what} can be grasped nowhere from above in this pose: the hand opens 80 mm, and its fingers need "
            "room beside what they hold; pass another up, pose='rest' or a smaller scale"
        )
