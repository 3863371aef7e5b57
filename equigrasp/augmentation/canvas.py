"""An empty table, on which what was cut out of demonstrations is put together anew."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from equigrasp.augmentation.crowding import UNDER_THE_HAND
from equigrasp.augmentation.cutouts import Cutout
from equigrasp.workspace import Motion, Workspace, warp

CLEARANCE = 3
"""Pixels that stay free between two objects that are put down."""
PLACEMENTS = 30
"""Places that are tried for an object before it is left out."""


class Canvas:
    """An empty table on which cut-out objects are put down without overlap."""

    def __init__(self, workspace: Workspace, table: NDArray[np.uint8]) -> None:
        self.workspace = workspace
        self.color = np.empty((*workspace.shape, 3), dtype=np.uint8)
        self.color[:] = np.tile(table, (workspace.columns, 1))  # by rows: by pixels it takes 40 times as long
        self.height = np.zeros(workspace.shape, dtype=np.float32)
        self.taken = np.zeros(workspace.shape, dtype=bool)
        self.table = table

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
        mask = warp(cutout.mask, to_square, (side, side), 0.0) > 0.5
        inside_rows, inside_columns = np.nonzero(mask)
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
            target_rows = inside_rows + place[1] - middle[1]
            target_columns = inside_columns + place[0] - middle[0]
            if not self.taken[target_rows, target_columns].any():
                break
        else:
            return None
        table = tuple(int(value) for value in self.table)
        color = warp(cutout.color, to_square, (side, side), table)
        height = warp(cutout.height, to_square, (side, side), 0.0)
        self.color[target_rows, target_columns] = color[inside_rows, inside_columns]
        self.height[target_rows, target_columns] = height[inside_rows, inside_columns]
        kept_rows, kept_columns = np.nonzero(ndimage.binary_dilation(mask, iterations=CLEARANCE))
        kept_rows, kept_columns = kept_rows + place[1] - middle[1], kept_columns + place[0] - middle[0]
        inside = (kept_rows >= 0) & (kept_rows < rows) & (kept_columns >= 0) & (kept_columns < columns)
        self.taken[kept_rows[inside], kept_columns[inside]] = True
        moved = (place - np.rint(cutout.centre)) * space.pixel
        return Motion(0.0, float(moved[0]), -float(moved[1])) @ turn


def _shift(offset: NDArray | tuple[int, int]) -> NDArray[np.float64]:
    matrix = np.eye(3)
    matrix[:2, 2] = offset
    return matrix
