"""A demonstration taken apart: its target, the objects around it, the bare table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from equigrasp.augmentation.table import LOWEST, Table, above, find_table
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Observation
from equigrasp.workspace import WORKSPACE, Workspace, table_color, was_seen

MARGIN = 4
"""Pixels of table that are cut out around an object, so that its edge keeps its look when it is turned."""
SMALLEST = 12
"""Pixels: a component with fewer is noise of the cameras."""
NEAR = 0.04
"""Metres, half of the hand's opening: a grasp that is further from what stands on the table holds nothing of it."""
TURNS = np.pi * (np.arange(36) + 0.5) / 36
"""Radians, in which a target is tried to fit; not as it was, in which whatever was cut out fits."""


@dataclass(frozen=True, eq=False)
class Cutout:
    """An object cut out of a scene.

    Attributes:
        color: `(h, w, 3)` uint8, with `MARGIN` pixels of table around the object.
        height: `(h, w)` float32, metres above the table.
        mask: `(h, w)` float32, 1 on the object and its edge.
        corner: (u, v) of the cut's first pixel in the scene's heightmap.
        name: the object's name if a demonstrator said it, else None.
        number: its place among all that an `Augmentation` has cut out.
    """

    color: NDArray[np.uint8]
    height: NDArray[np.float32]
    mask: NDArray[np.float32]
    corner: tuple[int, int]
    name: str | None
    number: int = 0

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """`(h, w, 3)`: the colours that it is put down in, its own."""
        return self.color

    @property
    def centre(self) -> NDArray[np.float64]:
        """(u, v) of the cut's middle in the scene's heightmap."""
        rows, columns = self.mask.shape
        return np.array([self.corner[0] + (columns - 1) / 2, self.corner[1] + (rows - 1) / 2])


@dataclass(frozen=True, eq=False)
class Scene:
    """A demonstration taken apart: its target, the other objects around it, the bare table's colour and level.

    The level is `(H, W)` float32, metres above z = 0: there the table of a camera of one's own may seem to lie.
    """

    demonstration: Demonstration
    target: Cutout
    others: tuple[Cutout, ...]
    table: NDArray[np.uint8]
    level: NDArray[np.float32]


def take_apart(demonstration: Demonstration, workspace: Workspace = WORKSPACE) -> Scene:
    """Cut a demonstration's objects out by the connected components of its height; the target is nearest the grasp.

    Args:
        demonstration: on the workspace's grid.
        workspace: the grid.

    Raises:
        InputError: if nothing stands on the table, or no target can be told from it: what is nearest the grasp is most
            of what was seen, or too large to be put down in another turn, or, of a table that strays, far from it.
    """
    table = find_table(demonstration.observation)
    observation = above(demonstration.observation, table)
    standing = observation.height > table.lowest
    components, count = ndimage.label(ndimage.binary_dilation(standing))
    sizes = ndimage.sum_labels(standing, components, range(1, count + 1))
    kept = [index + 1 for index in range(count) if sizes[index] >= SMALLEST]
    if not kept:
        raise InputError(
            f"{demonstration} shows an empty table, with nothing that stands out by more than "
            f"{1000 * table.lowest:.1f} mm; recombination needs objects (--recombination 0 does without)"
        )
    components = np.where(np.isin(components, kept), components, 0)
    # the grasp's own pixel may lie in a gap of its object, as between the blades of scissors
    u, v, _ = workspace.to_action(demonstration.grasp)
    rows, columns = ndimage.distance_transform_edt(components == 0, return_distances=False, return_indices=True)[
        :, v, u
    ]
    chosen = components[rows, columns]
    _check_target(demonstration, table, components == chosen, workspace)
    others = tuple(cut(observation, components == label, None) for label in kept if label != chosen)
    return Scene(
        demonstration,
        cut(observation, components == chosen, demonstration.target),
        others,
        table_color(observation),
        table.level,
    )


def _check_target(demonstration: Demonstration, table: Table, target: NDArray[np.bool_], workspace: Workspace) -> None:
    """Raise an InputError unless this can be the target, and be put down elsewhere: or no example were recombined."""
    rows, columns = np.nonzero(target)
    share = len(rows) / np.count_nonzero(was_seen(demonstration.observation))
    found = f"covers {share:.0%} of what was seen"
    if share <= 0.5:
        off = np.hypot(columns - demonstration.grasp.u, rows - demonstration.grasp.v).min() * workspace.pixel
        if table.lowest > LOWEST and off > NEAR:
            found = f"is {1000 * off:.0f} mm from the grasp"
        elif not _fits(rows, columns, workspace):
            found = "is too large to be put down in another turn"
        else:
            return
    level, lowest = 1000 * float(table.level.mean()), 1000 * table.lowest
    raise InputError(
        f"recombination cannot tell the target of {demonstration} from its table, which seems to lie {level:.1f} mm "
        f"above z = 0: what stands out by more than {lowest:.1f} mm and is nearest the grasp {found}; correct the "
        "camera's pose, smooth the depth, clear away what touches the target, or train with --recombination 0"
    )


def _fits(rows: NDArray[np.int64], columns: NDArray[np.int64], workspace: Workspace) -> bool:
    """Whether pixels fit into the heightmap in one of `TURNS`."""
    return any(
        np.ptp(columns * np.cos(turn) - rows * np.sin(turn)) <= workspace.columns - 1
        and np.ptp(columns * np.sin(turn) + rows * np.cos(turn)) <= workspace.rows - 1
        for turn in TURNS
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
