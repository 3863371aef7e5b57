"""Where the table lies in a heightmap: at z = 0 in the simulator, about there under a camera of one's own.

A camera's pose is a few millimetres or half a degree off, and its depth strays. Then a table stands out of z = 0 as its
objects do, and what is to be told apart is measured from the plane that fits it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equigrasp.grasp import Observation
from equigrasp.workspace import was_seen

LOWEST = 0.004
"""Metres: what stands higher than this above a table that does not stray is an object, not table."""
FLAT = 0.0005
"""Metres: a table whose heights are less is at z = 0 and does not stray, as the simulator's."""
BEYOND = 4.0
"""Standard deviations of the table's heights that an object stands out by, where that is more than `LOWEST`."""
ROUNDS = 10
"""Times that the plane is fitted, each time to what lay near the last one."""
EVERY = 7
"""Which of the pixels it is fitted to; all would say the same and take 80 ms."""


@dataclass(frozen=True, eq=False)
class Table:
    """The bare table under a scene.

    Attributes:
        level: `(H, W)` float32, metres: how high its surface lies, 0 at the least, as heightmaps have it.
        lowest: metres above `level`; what stands higher is an object.
    """

    level: NDArray[np.float32]
    lowest: float


def find_table(observation: Observation) -> Table:
    """The plane that most of what was seen lies near; z = 0 where a tenth lies there, and little just above it.

    Args:
        observation: of a table of which more is bare than covered, unless it lies at z = 0.
    """
    height = observation.height
    rows, columns = np.nonzero(was_seen(observation))
    seen = height[rows, columns].astype(np.float64)
    flat, low = np.count_nonzero(seen < FLAT), np.count_nonzero(seen < LOWEST)
    # the feet of objects and what is nearly as low as the table are a small share of what is low, noise is most of it
    if flat >= max(0.1 * len(seen), 0.75 * low):
        return Table(np.zeros(height.shape, dtype=np.float32), LOWEST)
    rows, columns, seen = rows[::EVERY], columns[::EVERY], seen[::EVERY]
    at = np.column_stack([rows, columns, np.ones(len(rows))])
    plane = np.array([0.0, 0.0, np.median(seen)])
    deviation = 0.0
    for _ in range(ROUNDS):
        off = seen - at @ plane
        # 1.48 of the median are a standard deviation, which what stands on the table would be the most of
        near = np.abs(off) <= max(LOWEST, 3 * 1.48 * float(np.median(np.abs(off))))
        deviation = float(off[near].std())
        plane = np.linalg.lstsq(at[near], seen[near], rcond=None)[0]
    grid = np.indices(height.shape)
    level = np.maximum(plane[0] * grid[0] + plane[1] * grid[1] + plane[2], 0.0).astype(np.float32)
    return Table(level, max(LOWEST, BEYOND * deviation))


def above(observation: Observation, table: Table) -> Observation:
    """The same with its heights measured from the table, 0 at the least."""
    return Observation(observation.color, np.maximum(observation.height - table.level, 0))
