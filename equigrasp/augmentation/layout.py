"""What lies where in an example, before it is painted: a scene moved as a whole, or objects put together on a table.

To say so takes a few numbers an object, and to paint it all pixels. `Moved.paint` and `Together.paint` do it here, with
numpy; `equigrasp.training.painter` does it on a device that holds what was cut out, so that the numbers are all that
goes over.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equigrasp.augmentation.cutouts import Cutout
from equigrasp.augmentation.laying import lay_color, lay_height, move
from equigrasp.grasp import Demonstration, Observation
from equigrasp.workspace import Motion, Workspace, backward


@dataclass(frozen=True, eq=False)
class Placement:
    """Where an object lies: in a square, turned, and with the square on the heightmap, whole pixels further.

    Attributes:
        cutout: the object.
        turn: `(3, 3)`, takes (u, v, 1) of the cut to (u, v, 1) of the square, in pixel centres.
        shift: (u, v) of the square's first pixel in the heightmap.
        rows: of the pixels that the object covers, in the square.
        columns: of the same.
    """

    cutout: Cutout
    turn: NDArray[np.float64]
    shift: tuple[int, int]
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]

    @property
    def pixel_map(self) -> NDArray[np.float64]:
        """`(3, 3)`, takes (u, v, 1) of the cut to (u, v, 1) of the heightmap, in pixel centres."""
        moved = self.turn.copy()
        moved[:2, 2] += self.shift
        return moved


@dataclass(frozen=True, eq=False)
class Moved:
    """A demonstration's scene under one g.

    Attributes:
        number: which demonstration.
        demonstration: itself.
        motion: g.
        table: `(3,)` uint8, the colour of what comes in from outside.
        level: metres, its height.
    """

    number: int
    demonstration: Demonstration
    motion: Motion
    table: NDArray[np.uint8]
    level: float

    def paint(self, workspace: Workspace) -> Observation:
        """The observation, bilinear."""
        seen, way = self.demonstration.observation, backward(workspace.pixel_map(self.motion))
        return Observation(*move(seen.color, seen.height, way, self.table, self.level))


@dataclass(frozen=True, eq=False)
class Together:
    """Objects on the bare table of a scene.

    Attributes:
        number: which scene.
        table: `(3,)` uint8, the table's colour.
        level: `(H, W)` float32, metres: how high its surface lies.
        placements: the objects, apart from each other.
    """

    number: int
    table: NDArray[np.uint8]
    level: NDArray[np.float32]
    placements: tuple[Placement, ...]

    def paint(self, workspace: Workspace) -> Observation:
        """The observation, bilinear."""
        color = np.empty((*workspace.shape, 3), dtype=np.uint8)
        color[:] = np.tile(self.table, (workspace.columns, 1))  # by rows: by pixels it takes 40 times as long
        for each in self.placements:
            right, down = each.shift
            lay_color(color, each.cutout.pixels, backward(each.turn), each.rows, each.columns, down, right)
        return Observation(color, heights(self.placements, workspace) + self.level)


Layout = Moved | Together


def heights(placements: Iterable[Placement], workspace: Workspace) -> NDArray[np.float32]:
    """`(H, W)`: how high objects stand above the table that they stand on, metres."""
    height = np.zeros(workspace.shape, dtype=np.float32)
    for each in placements:
        right, down = each.shift
        lay_height(height, each.cutout.height, backward(each.turn), each.rows, each.columns, down, right)
    return height
