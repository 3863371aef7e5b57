"""A demonstration taken apart: its target, the objects around it, the bare table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Observation
from equigrasp.workspace import WORKSPACE, Workspace, table_color

MARGIN = 4
"""Pixels of table that are cut out around an object, so that its edge keeps its look when it is turned."""
LOWEST = 0.004
"""Metres: what stands higher than this is an object, not table."""
SMALLEST = 12
"""Pixels: a component with fewer is noise of the cameras."""


@dataclass(frozen=True, eq=False)
class Cutout:
    """An object cut out of a scene.

    Attributes:
        color: `(h, w, 3)` uint8, with `MARGIN` pixels of table around the object.
        height: `(h, w)` float32, metres.
        mask: `(h, w)` float32, 1 on the object and its edge.
        corner: (u, v) of the cut's first pixel in the scene's heightmap.
        name: the object's name if a demonstrator said it, else None.
    """

    color: NDArray[np.uint8]
    height: NDArray[np.float32]
    mask: NDArray[np.float32]
    corner: tuple[int, int]
    name: str | None

    @property
    def centre(self) -> NDArray[np.float64]:
        """(u, v) of the cut's middle in the scene's heightmap."""
        rows, columns = self.mask.shape
        return np.array([self.corner[0] + (columns - 1) / 2, self.corner[1] + (rows - 1) / 2])


@dataclass(frozen=True, eq=False)
class Scene:
    """A demonstration taken apart: its target, the other objects around it, the bare table's colour."""

    demonstration: Demonstration
    target: Cutout
    others: tuple[Cutout, ...]
    table: NDArray[np.uint8]


def take_apart(demonstration: Demonstration, workspace: Workspace = WORKSPACE) -> Scene:
    """Cut a demonstration's objects out by the connected components of its height; the target is nearest the grasp.

    Args:
        demonstration: on the workspace's grid.
        workspace: the grid.

    Raises:
        InputError: if nothing stands on the table.
    """
    observation = demonstration.observation
    components, count = ndimage.label(ndimage.binary_dilation(observation.height > LOWEST))
    sizes = ndimage.sum_labels(observation.height > LOWEST, components, range(1, count + 1))
    kept = [index + 1 for index in range(count) if sizes[index] >= SMALLEST]
    if not kept:
        raise InputError(f"{demonstration} shows an empty table; recombination needs objects")
    components = np.where(np.isin(components, kept), components, 0)
    # the grasp's own pixel may lie in a gap of its object, as between the blades of scissors
    u, v, _ = workspace.to_action(demonstration.grasp)
    rows, columns = ndimage.distance_transform_edt(components == 0, return_distances=False, return_indices=True)[
        :, v, u
    ]
    chosen = components[rows, columns]
    others = tuple(cut(observation, components == label, None) for label in kept if label != chosen)
    return Scene(
        demonstration,
        cut(observation, components == chosen, demonstration.target),
        others,
        table_color(observation),
    )


def cut(observation: Observation, mask: NDArray[np.bool_], name: str | None) -> Cutout:
    """Cut one object out, with a margin of table where the heightmap has it."""
    rows, columns = np.nonzero(mask)
    bottom, right = observation.shape
    top, left = max(rows.min() - MARGIN, 0), max(columns.min() - MARGIN, 0)
    window = np.s_[top : min(rows.max() + MARGIN + 1, bottom), left : min(columns.max() + MARGIN + 1, right)]
    return Cutout(
        np.ascontiguousarray(observation.color[window]),
        # what stands nearby may reach into the window; it is not part of this object
        np.where(mask, observation.height, 0.0).astype(np.float32)[window],
        mask.astype(np.float32)[window],
        (int(left), int(top)),
        name,
    )
