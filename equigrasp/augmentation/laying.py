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
            u, v = _place(backward, row, column)
            if u < 0.0 or u >= width or v < 0.0 or v >= height:
                continue
            left, right, du = _between(u, width)
            top, bottom, dv = _between(v, height)
            if _height(mask, left, right, top, bottom, du, dv) > 0.5:
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
        u, v = _place(backward, row, column)
        first, second, du = _between(u, width)
        top, bottom, dv = _between(v, height)
        for channel in range(3):
            seen = _color(color, channel, first, second, top, bottom, du, dv)
            canvas[row + down, column + right, channel] = seen


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
        u, v = _place(backward, row, column)
        first, second, du = _between(u, width)
        top, bottom, dv = _between(v, height)
        canvas[row + down, column + right] = _height(values, first, second, top, bottom, du, dv)


@compiled
def move(
    color: NDArray[np.uint8],
    height: NDArray[np.float32],
    backward: NDArray[np.float64],
    table: NDArray[np.uint8],
    level: float,
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """A whole scene under an affine map, in half of the time that it takes as two pictures.

    Args:
        color: `(H, W, 3)`.
        height: `(H, W)`, metres.
        backward: as `covered` takes it.
        table: `(3,)`, the colour of what comes in from outside.
        level: its height, metres.
    """
    rows, columns = height.shape
    colors, heights = np.empty_like(color), np.empty_like(height)
    for row in range(rows):
        for column in range(columns):
            u, v = _place(backward, row, column)
            if u < 0.0 or u >= columns or v < 0.0 or v >= rows:
                heights[row, column] = level
                for channel in range(3):
                    colors[row, column, channel] = table[channel]
                continue
            left, right, du = _between(u, columns)
            top, bottom, dv = _between(v, rows)
            heights[row, column] = _height(height, left, right, top, bottom, du, dv)
            for channel in range(3):
                colors[row, column, channel] = _color(color, channel, left, right, top, bottom, du, dv)
    return colors, heights


@compiled
def _place(backward: NDArray[np.float64], row: int, column: int) -> tuple[float, float]:
    """Where the middle of a pixel was, from the first pixel's corner."""
    x, y = column + 0.5, row + 0.5
    return (
        backward[0, 0] * x + backward[0, 1] * y + backward[0, 2],
        backward[1, 0] * x + backward[1, 1] * y + backward[1, 2],
    )


@compiled
def _color(
    color: NDArray[np.uint8], channel: int, left: int, right: int, top: int, bottom: int, du: float, dv: float
) -> np.uint8:
    """Bilinear, cut off to a whole number."""
    a, b = float(color[top, left, channel]), float(color[top, right, channel])
    c, d = float(color[bottom, left, channel]), float(color[bottom, right, channel])
    upper, lower = a + (b - a) * du, c + (d - c) * du
    return np.uint8(upper + (lower - upper) * dv)


@compiled
def _height(
    height: NDArray[np.float32], left: int, right: int, top: int, bottom: int, du: float, dv: float
) -> np.float32:
    """Bilinear; the differences of neighbours are in float32, as Pillow has them."""
    upper = height[top, left] + (height[top, right] - height[top, left]) * du
    lower = height[bottom, left] + (height[bottom, right] - height[bottom, left]) * du
    return np.float32(upper + (lower - upper) * dv)


@compiled
def _between(place: float, size: int) -> tuple[int, int, float]:
    """The two pixels of a row of so many that a place in it, from its first corner, lies between, and how far on."""
    place -= 0.5
    first = math.floor(place)
    return max(first, 0), min(first + 1, size - 1), place - first
