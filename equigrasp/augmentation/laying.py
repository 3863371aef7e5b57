"""Cut-out objects on the grid of a heightmap, pixel by pixel, in compiled code: what is covered, free, painted.

Called through libraries of images, an object of 900 pixels took 0.7 ms to put down, most of it for what surrounds their
loops. The numbers are theirs to the bit, Pillow's bilinear ones: others would be other examples, and other trainings.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from equigrasp.compiled import compiled


@compiled
def covered(
    mask: NDArray[np.float32], backward: NDArray[np.float64], side: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the pixels of a square that a mask covers, once it is moved there, row by row.

    Args:
        mask: `(h, w)`, 1 on the object.
        backward: `(2, 3)`, takes (u, v, 1) in the square to (u, v) in the mask, both from the first pixel's corner.
        side: of the square, pixels.
    """
    height, width = mask.shape
    rows = np.empty(side * side, dtype=np.int64)
    columns = np.empty(side * side, dtype=np.int64)
    count = 0
    for row in range(side):
        for column in range(side):
            u = backward[0, 0] * (column + 0.5) + backward[0, 1] * (row + 0.5) + backward[0, 2]
            v = backward[1, 0] * (column + 0.5) + backward[1, 1] * (row + 0.5) + backward[1, 2]
            if u < 0.0 or u >= width or v < 0.0 or v >= height:
                continue
            left, right, du = _between(u, width)
            top, bottom, dv = _between(v, height)
            upper = mask[top, left] + (mask[top, right] - mask[top, left]) * du
            lower = mask[bottom, left] + (mask[bottom, right] - mask[bottom, left]) * du
            if np.float32(upper + (lower - upper) * dv) > 0.5:
                rows[count], columns[count] = row, column
                count += 1
    return rows[:count], columns[:count]


@compiled
def is_free(
    taken: NDArray[np.bool_], rows: NDArray[np.int64], columns: NDArray[np.int64], down: int, right: int
) -> bool:
    """Whether none of these pixels, shifted so far, is taken in `(H, W)`, in which they all lie."""
    for index in range(len(rows)):  # noqa: SIM110 (numba compiles no generator expression)
        if taken[rows[index] + down, columns[index] + right]:
            return False
    return True


@compiled
def keep_free(
    taken: NDArray[np.bool_],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    down: int,
    right: int,
    clearance: int,
) -> None:
    """Take these pixels, shifted so far, and what is so near along rows and columns together, in place."""
    height, width = taken.shape
    for index in range(len(rows)):
        row, column = rows[index] + down, columns[index] + right
        for v in range(max(row - clearance, 0), min(row + clearance + 1, height)):
            reach = clearance - abs(v - row)
            for u in range(max(column - reach, 0), min(column + reach + 1, width)):
                taken[v, u] = True


@compiled
def lay_color(
    canvas: NDArray[np.uint8],
    color: NDArray[np.uint8],
    backward: NDArray[np.float64],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    down: int,
    right: int,
) -> None:
    """Paint these pixels of a square, shifted so far, with an image's colours, in place: cut off to whole numbers.

    Args:
        canvas: `(H, W, 3)`.
        color: `(h, w, 3)`.
        backward: as `covered` takes it.
        rows: of the square.
        columns: of the square.
        down: pixels from the square to the canvas.
        right: pixels from the square to the canvas.
    """
    height, width = color.shape[:2]
    for index in range(len(rows)):
        row, column = rows[index], columns[index]
        u = backward[0, 0] * (column + 0.5) + backward[0, 1] * (row + 0.5) + backward[0, 2]
        v = backward[1, 0] * (column + 0.5) + backward[1, 1] * (row + 0.5) + backward[1, 2]
        first, second, du = _between(u, width)
        top, bottom, dv = _between(v, height)
        for channel in range(3):
            a, b = float(color[top, first, channel]), float(color[top, second, channel])
            c, d = float(color[bottom, first, channel]), float(color[bottom, second, channel])
            upper, lower = a + (b - a) * du, c + (d - c) * du
            canvas[row + down, column + right, channel] = np.uint8(upper + (lower - upper) * dv)


@compiled
def lay_height(
    canvas: NDArray[np.float32],
    values: NDArray[np.float32],
    backward: NDArray[np.float64],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    down: int,
    right: int,
) -> None:
    """As `lay_color`, of heights `(h, w)` on a canvas `(H, W)`, metres."""
    height, width = values.shape
    for index in range(len(rows)):
        row, column = rows[index], columns[index]
        u = backward[0, 0] * (column + 0.5) + backward[0, 1] * (row + 0.5) + backward[0, 2]
        v = backward[1, 0] * (column + 0.5) + backward[1, 1] * (row + 0.5) + backward[1, 2]
        first, second, du = _between(u, width)
        top, bottom, dv = _between(v, height)
        upper = values[top, first] + (values[top, second] - values[top, first]) * du
        lower = values[bottom, first] + (values[bottom, second] - values[bottom, first]) * du
        canvas[row + down, column + right] = np.float32(upper + (lower - upper) * dv)


@compiled
def _between(place: float, size: int) -> tuple[int, int, float]:
    """The two pixels of a row of so many that a place in it, from its first corner, lies between, and how far on."""
    place -= 0.5
    first = math.floor(place)
    return max(first, 0), min(first + 1, size - 1), place - first
