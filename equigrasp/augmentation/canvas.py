"""An empty table, on which what was cut out of demonstrations is put together anew."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from equigrasp.augmentation.crowding import UNDER_THE_HAND
from equigrasp.augmentation.cutouts import Cutout
from equigrasp.augmentation.laying import covered, is_free, keep_free
from equigrasp.augmentation.layout import Placement, heights
from equigrasp.workspace import Motion, Workspace, backward

CLEARANCE = 3
"""Pixels that stay free between two objects that are put down."""
PLACEMENTS = 30
"""Places that are tried for an object before it is left out."""


class Canvas:
    """An empty table on which cut-out objects are put down without overlap.

    Args:
        workspace: the grid.

    Attributes:
        placements: what was put down, in order.
    """

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self.placements: list[Placement] = []
        self._taken = np.zeros(workspace.shape, dtype=bool)

    @property
    def height(self) -> NDArray[np.float32]:
        """`(H, W)`, metres above the table, painted at each call."""
        return heights(self.placements, self.workspace)

    def put(self, cutout: Cutout, rng: np.random.Generator, near: NDArray[np.float64] | None = None) -> Motion | None:
        """Put an object down at a random pose where it is free of the others.

        Args:
            cutout: the object.
            rng: draws the pose.
            near: (u, v) that its middle is to be near, by `UNDER_THE_HAND`; None for anywhere.

        Returns:
            The motion that took it from its scene to here, or None if no free place was found.
        """
        space = self.workspace
        rows, columns = space.shape
        start = space.to_world(cutout.centre)
        turn = Motion(rng.uniform(0.0, 2 * math.pi)).about(*start)
        side = math.ceil(math.hypot(*cutout.mask.shape)) + 1 + 2 * CLEARANCE
        # turned about the middle of a square large enough for any angle, which then moves by whole pixels
        middle = np.array([side // 2, side // 2])
        to_square = _shift(middle - np.rint(cutout.centre)) @ space.pixel_map(turn) @ _shift(cutout.corner)
        inside_rows, inside_columns = covered(cutout.mask, backward(to_square), side)
        low = middle - [inside_columns.min(), inside_rows.min()]
        high = np.array([columns, rows]) - 1 - ([inside_columns.max(), inside_rows.max()] - middle)
        if near is not None:
            spread = round(UNDER_THE_HAND / space.pixel)
            wanted = np.rint(near).astype(np.int64)
            low, high = np.maximum(low, wanted - spread), np.minimum(high, wanted + spread)
        if np.any(high < low):
            return None
        for _ in range(PLACEMENTS):
            place = rng.integers(low, high + 1)
            right, down = (place - middle).tolist()
            if is_free(self._taken, inside_rows, inside_columns, down, right):
                break
        else:
            return None
        keep_free(self._taken, inside_rows, inside_columns, down, right, CLEARANCE)
        self.placements.append(Placement(cutout, to_square, (right, down), inside_rows, inside_columns))
        moved = (place - np.rint(cutout.centre)) * space.pixel
        return Motion(0.0, float(moved[0]), -float(moved[1])) @ turn


def _shift(offset: NDArray | tuple[int, int]) -> NDArray[np.float64]:
    matrix = np.eye(3)
    matrix[:2, 2] = offset
    return matrix
