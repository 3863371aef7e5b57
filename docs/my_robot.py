"""Demonstrations from a table of your own: what a depth camera saw, what was said, where the hand closed."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from equigrasp.collection import Collection
from equigrasp.demonstrations import store
from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.heightmap import Camera, fuse
from equigrasp.workspace import WORKSPACE


def observe(
    color: NDArray[np.uint8],  # (h, w, 3), RGB
    depth: NDArray[np.float32],  # (h, w), metres along the optical axis; 0 or NaN where nothing was read
    intrinsics: NDArray[np.float64],  # (3, 3), pixels
    pose: NDArray[np.float64],  # (4, 4), camera -> table; the camera looks along its +z, its y points down
) -> Observation:
    """The table from above; `fuse` takes pictures of several cameras as well."""
    return fuse([Camera(color, depth, intrinsics, pose)])


def demonstration(
    number: int,
    observation: Observation,  # before the hand came into the picture
    x: float,  # metres, between the fingertips; (0, 0) is the table's middle
    y: float,
    angle: float,  # radians, of the line between the fingertips, counter-clockwise from +x seen from above
    target: str,
    part: str,
) -> Demonstration:
    """One grasp that was shown; `words` are those of the sentence that say what is meant."""
    u, v = WORKSPACE.to_pixel([x, y])
    return Demonstration(
        observation=observation,
        instruction=f"pick up the {target} by its {part}",
        grasp=Grasp(u, v, angle),
        task="my-table",
        goal=number,
        target=target,
        part=part,
        kind="part",
        words=(target, part),
        demo=0,
        seed=number,
        quality=1.0,
    )


def keep(demonstrations: list[Demonstration], folder: Path) -> None:
    """A folder that `equigrasp train --data` takes."""
    goals = tuple(each.goal for each in demonstrations)
    store(Collection("my-table", goals=(goals,), seed=0, camera="my-camera"), demonstrations, folder)
