"""Cells and bins, and grasps: labels and grasps are one map, and the best grasp is found between cells and bins."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from equigrasp import Grasp
from equigrasp.read_out import ReadOut

BINS = st.sampled_from([36, 20, 90])


def apart(a: Grasp, b: Grasp) -> tuple[float, float]:
    """Pixels and degrees between two grasps."""
    turn = abs((a.theta - b.theta + math.pi / 2) % math.pi - math.pi / 2)
    return math.hypot(a.u - b.u, a.v - b.v), math.degrees(turn)


def indices(label: int, read_out: ReadOut) -> tuple[int, int, int]:
    """Bin, row and column of a flat index."""
    cells = read_out.rows * read_out.columns
    return label // cells, label % cells // read_out.columns, label % read_out.columns


@given(st.floats(-0.5, 319.499), st.floats(-0.5, 159.499), st.floats(-10, 10), st.sampled_from([1, 2]), BINS)
def test_a_label_is_the_nearest_cell_and_bin(u: float, v: float, theta: float, stride: int, bins: int) -> None:
    read_out, grasp = ReadOut(160 // stride, 320 // stride, stride, bins), Grasp(u, v, theta)
    label = read_out.label(grasp)
    cell = read_out.grasp(*indices(label, read_out))
    assert max(abs(cell.u - u), abs(cell.v - v)) <= stride / 2 + 1e-9
    assert apart(cell, grasp)[1] <= 90 / bins + 1e-6
    assert read_out.label(cell) == label


@given(st.floats(2, 317), st.floats(2, 157), st.floats(0, math.pi, exclude_max=True), st.sampled_from([1, 2]), BINS)
def test_the_best_grasp_is_found_between_cells_and_bins(
    u: float, v: float, theta: float, stride: int, bins: int
) -> None:
    read_out = ReadOut(160 // stride, 320 // stride, stride, bins)
    offset = (stride - 1) / 2
    index, row, column = np.mgrid[:bins, : read_out.rows, : read_out.columns].astype(float)
    turn = (index * math.pi / bins - theta + math.pi / 2) % math.pi - math.pi / 2
    scores = -((stride * column + offset - u) ** 2) - (stride * row + offset - v) ** 2 - 100 * turn**2
    found = read_out.best(scores)
    distance, angle = apart(found, Grasp(u, v, theta))
    assert distance < 1e-6
    assert angle < 1e-6
    nearest = read_out.grasp(*indices(int(scores.argmax()), read_out))
    assert apart(nearest, found)[0] <= stride


def test_a_plateau_and_a_border_are_not_refined() -> None:
    read_out, scores = ReadOut(4, 6, 2), np.zeros((36, 4, 6))
    assert apart(read_out.best(scores), read_out.grasp(0, 0, 0)) == (0, 0)
    scores[35, 3, 5] = 1
    assert apart(read_out.best(scores), read_out.grasp(35, 3, 5)) == (0, 0)


@pytest.mark.parametrize("grasp", [Grasp(-0.6, 5, 0), Grasp(5, 159.6, 0), Grasp(320, 5, 0)])
def test_a_grasp_outside_has_no_label(grasp: Grasp) -> None:
    with pytest.raises(ValueError, match="outside the heightmap of 160 x 320 pixels"):
        ReadOut(80, 160, 2).label(grasp)
