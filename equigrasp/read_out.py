"""Scores on a grid of cells and angles <-> grasps in full-resolution pixels: one becomes the other here alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from equigrasp.errors import InputError
from equigrasp.grasp import Grasp
from equigrasp.workspace import WORKSPACE, nearest_bin


@dataclass(frozen=True)
class ReadOut:
    """The grid of cells on which grasps are scored, and its two-way map to full-resolution grasps.

    Cell (row, column) of stride s is centred at pixel (s row + (s - 1) / 2, s column + (s - 1) / 2).

    Attributes:
        rows: H / stride.
        columns: W / stride.
        stride: full-resolution pixels a cell.
        bins: angles in [0, pi).
    """

    rows: int
    columns: int
    stride: int
    bins: int = WORKSPACE.bins

    def label(self, grasp: Grasp) -> int:
        """Grasp -> its cell and bin as the flat index into `(bins, rows, columns)`.

        Raises:
            InputError: if the grasp lies outside the heightmap.
        """
        column = math.floor((grasp.u + 0.5) / self.stride)
        row = math.floor((grasp.v + 0.5) / self.stride)
        if not (0 <= row < self.rows and 0 <= column < self.columns):
            raise InputError(
                f"{grasp} lies outside the heightmap of {self.stride * self.rows} x "
                f"{self.stride * self.columns} pixels; leave it out of the labels"
            )
        return (nearest_bin(grasp.theta, self.bins) * self.rows + row) * self.columns + column

    def grasp(self, index: float, row: float, column: float) -> Grasp:
        """(bin, row, column), whole or between cells -> Grasp in full-resolution pixels."""
        offset = (self.stride - 1) / 2
        theta = index * math.pi / self.bins
        return Grasp(self.stride * column + offset, self.stride * row + offset, theta)

    def best(self, scores: np.ndarray) -> Grasp:
        """Scores `(bins, rows, columns)` -> the grasp at their maximum, refined to within a cell and a bin."""
        index, row, column = (int(i) for i in np.unravel_index(int(scores.argmax()), scores.shape))
        around = scores[[(index - 1) % self.bins, index, (index + 1) % self.bins], row, column]
        return self.grasp(
            index + vertex(around),
            row + vertex(scores[index, max(row - 1, 0) : row + 2, column]),
            column + vertex(scores[index, row, max(column - 1, 0) : column + 2]),
        )


def vertex(values: np.ndarray) -> float:
    """Where the parabola through three values about a maximum peaks, in -0.5 .. 0.5; 0 at a border or beside -inf."""
    if len(values) < 3:
        return 0.0
    left, middle, right = (float(value) for value in values)
    curvature = left - 2 * middle + right
    if not -math.inf < curvature < 0:
        return 0.0
    return min(max((left - right) / (2 * curvature), -0.5), 0.5)
