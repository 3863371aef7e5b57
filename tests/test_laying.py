"""What compiled code covers, keeps free and paints is what Pillow and SciPy do, to the bit."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from equigrasp.augmentation import laying
from equigrasp.workspace import backward, warp

SIDE = 24


Cut = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8], NDArray[np.float64]]
"""A mask with soft and hard edges, heights, colours, and a map of their pixels into a square."""


@st.composite
def cuts(draw: st.DrawFn) -> Cut:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = draw(st.integers(1, 14)), draw(st.integers(1, 14))
    mask = np.clip(rng.normal(0.7, 0.6, shape), 0, 1).astype(np.float32)
    angle = draw(st.sampled_from([0.0, math.pi / 2, math.pi]) | st.floats(0, 2 * math.pi))
    c, s = math.cos(angle), math.sin(angle)
    place = draw(st.tuples(*[st.integers(-4, SIDE) | st.floats(-4, SIDE)] * 2))
    pixel_map = np.array([[c, -s, place[0]], [s, c, place[1]], [0, 0, 1]])
    height = rng.normal(0.03, 0.05, shape).astype(np.float32)
    return mask, height, rng.integers(0, 256, (*shape, 3), dtype=np.uint8), pixel_map


def as_pillow(cut: Cut) -> bool:
    """The law; painted two pixels further down and one to the right, on a canvas of that much more."""
    mask, height, color, pixel_map = cut
    way = backward(pixel_map)
    rows, columns = laying.covered(mask, way, SIDE)
    inside = warp(mask, pixel_map, (SIDE, SIDE), 0.0) > 0.5
    if not np.array_equal(np.stack([rows, columns]), np.stack(np.nonzero(inside))):
        return False
    colors, heights = np.zeros((SIDE + 2, SIDE + 1, 3), np.uint8), np.zeros((SIDE + 2, SIDE + 1), np.float32)
    laying.lay_color(colors, color, way, rows, columns, 2, 1)
    laying.lay_height(heights, height, way, rows, columns, 2, 1)
    expected_colors = np.where(inside[..., None], warp(color, pixel_map, (SIDE, SIDE), (7, 7, 7)), 0)
    expected_heights = np.where(inside, warp(height, pixel_map, (SIDE, SIDE), -1.0), 0)
    margin = ((2, 0), (1, 0))
    return np.array_equal(colors, np.pad(expected_colors, (*margin, (0, 0)))) and np.array_equal(
        heights, np.pad(expected_heights, margin)
    )


@given(cuts())
def test_what_is_put_down_is_what_pillow_puts_down(cut: Cut) -> None:
    assert as_pillow(cut)


@given(cuts())
def test_a_scene_moves_as_two_pictures_do(cut: Cut) -> None:
    _, height, color, pixel_map = cut
    table = np.array([1, 2, 250], np.uint8)
    colors, heights = laying.move(color, height, backward(pixel_map), table, 0.1)
    rows, columns = height.shape
    assert np.array_equal(colors, warp(color, pixel_map, (rows, columns), (1, 2, 250)))
    assert np.array_equal(heights, warp(height, pixel_map, (rows, columns), 0.1))


@given(cuts(), st.integers(0, 4), st.integers(-9, 9), st.integers(-9, 9))
def test_what_is_kept_free_is_what_a_dilation_takes(cut: Cut, clearance: int, down: int, right: int) -> None:
    mask, _, _, pixel_map = cut
    rows, columns = laying.covered(mask, backward(pixel_map), SIDE)
    there = np.zeros((SIDE + 40, SIDE + 40), bool)
    there[rows + down + 20, columns + right + 20] = True
    expected = ndimage.binary_dilation(there, iterations=clearance) if clearance else there
    taken = np.zeros((SIDE, SIDE), bool)
    laying.keep_free(taken, rows, columns, down, right, clearance)
    assert np.array_equal(taken, expected[20:-20, 20:-20])
    for v, u in np.argwhere(taken)[:3]:
        assert not laying.is_free(taken, np.array([v + 5]), np.array([u - 3]), -5, 3)
    for v, u in np.argwhere(~taken)[:3]:
        assert laying.is_free(taken, np.array([v + 5]), np.array([u - 3]), -5, 3)


@pytest.mark.parametrize(
    "broken",
    [
        lambda place, size: (min(max(math.floor(place - 0.5 + 0.5), 0), size - 1),) * 2 + (0.0,),
        lambda place, size: (math.floor(place - 0.5) % size, (math.floor(place - 0.5) + 1) % size, (place - 0.5) % 1),
    ],
    ids=["the nearest pixel", "round the edge"],
)
def test_another_interpolation_would_be_noticed(
    monkeypatch: pytest.MonkeyPatch, broken: Callable[[float, int], tuple[int, int, float]]
) -> None:
    """The law above, of the same functions as Python with one of another kind between the pixels."""
    turned = np.array([[0.6, -0.8, 12.3], [0.8, 0.6, 3.1], [0, 0, 1]])
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (9, 12, 3), dtype=np.uint8)
    cut = np.ones((9, 12), np.float32), rng.normal(size=(9, 12)).astype(np.float32), color, turned
    for name in ("covered", "lay_color", "lay_height", "_place", "_color", "_height"):
        monkeypatch.setattr(laying, name, getattr(laying, name).py_func)
    assert as_pillow(cut)
    monkeypatch.setattr(laying, "_between", broken)
    assert not as_pillow(cut)
