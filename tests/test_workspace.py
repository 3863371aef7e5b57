"""Laws of the conversions and of SE(2)'s action: what every other part of the project relies on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from equigrasp.grasp import Grasp, Observation
from equigrasp.workspace import WORKSPACE, Motion, Workspace, inverse, table_color, warp

angles = st.floats(-10, 10)
metres = st.floats(-0.3, 0.3)
motions = st.builds(Motion, angles, metres, metres)
grasps = st.builds(Grasp, st.floats(0, 319), st.floats(0, 159), st.floats(0, math.pi))


def angle_between(first: float, second: float) -> float:
    """Between two closing axes, which are lines: modulo pi."""
    difference = (first - second) % math.pi
    return min(difference, math.pi - difference)


def close(first: Grasp, second: Grasp, pixels: float = 1e-6) -> bool:
    return (
        math.hypot(first.u - second.u, first.v - second.v) < pixels and angle_between(first.theta, second.theta) < 1e-6
    )


@given(st.floats(-0.5, 319.5), st.floats(-0.5, 159.5))
def test_pixel_and_metre_are_inverse(u: float, v: float) -> None:
    assert WORKSPACE.to_pixel(WORKSPACE.to_world([u, v])) == pytest.approx([u, v], abs=1e-9)


def test_the_axes_point_where_the_conventions_say() -> None:
    x0, y0 = WORKSPACE.to_world([0, 0])
    x1, y1 = WORKSPACE.to_world([319, 159])
    assert x1 > x0
    assert y1 < y0
    assert (x0, y0) == pytest.approx((-0.5 + 0.0015625, 0.25 - 0.0015625))


@given(st.integers(0, 35), st.floats(-0.499, 0.499), st.integers(-3, 3))
def test_a_bin_holds_the_angles_nearest_to_its_centre(index: int, offset: float, turns: int) -> None:
    theta = WORKSPACE.to_angle(index) + offset * math.pi / 36 + turns * math.pi
    assert WORKSPACE.to_bin(theta) == index


@given(st.integers(0, 319), st.integers(0, 159), st.integers(0, 35))
def test_action_and_grasp_are_inverse(u: int, v: int, index: int) -> None:
    assert WORKSPACE.to_action(WORKSPACE.to_grasp([u, v, index])).tolist() == [u, v, index]


@given(st.floats(-50, 370), st.floats(-50, 210), st.floats(0, math.pi))
def test_an_action_is_at_the_nearest_pixel_that_there_is(u: float, v: float, theta: float) -> None:
    """Of a grasp beside the heightmap too, as a part that reaches over the table's edge asks for."""
    column, row, _ = WORKSPACE.to_action(Grasp(u, v, theta))
    assert column in range(WORKSPACE.columns)
    assert row in range(WORKSPACE.rows)
    assert abs(column - u) == np.abs(np.arange(WORKSPACE.columns) - u).min()
    assert abs(row - v) == np.abs(np.arange(WORKSPACE.rows) - v).min()


@given(motions, motions, metres, metres)
def test_composition_acts_as_one_after_the_other(g: Motion, h: Motion, x: float, y: float) -> None:
    assert (g @ h)([x, y]) == pytest.approx(g(h([x, y])), abs=1e-9)


@given(motions, metres, metres)
def test_the_inverse_undoes(g: Motion, x: float, y: float) -> None:
    assert g.inverse()(g([x, y])) == pytest.approx([x, y], abs=1e-9)


@given(motions, motions)
def test_the_group_is_the_matrices(g: Motion, h: Motion) -> None:
    """Homogeneous matrices are the independent reference for composition and inverse."""
    assert (g @ h).matrix() == pytest.approx(g.matrix() @ h.matrix(), abs=1e-9)
    assert g.inverse().matrix() == pytest.approx(np.linalg.inv(g.matrix()), abs=1e-9)


@given(motions, metres, metres)
def test_turning_about_a_point_keeps_the_point(g: Motion, x: float, y: float) -> None:
    assert Motion(g.angle).about(x, y)([x, y]) == pytest.approx([x, y], abs=1e-9)


@given(motions, motions, grasps)
def test_the_action_on_grasps_is_a_group_action(g: Motion, h: Motion, grasp: Grasp) -> None:
    assert close(WORKSPACE.move_grasp(g @ h, grasp), WORKSPACE.move_grasp(g, WORKSPACE.move_grasp(h, grasp)))


@given(motions, grasps)
def test_fingertips_move_as_points_of_the_world(g: Motion, grasp: Grasp) -> None:
    """A grasp's two fingertips, moved one by one, are the fingertips of the moved grasp."""

    def tips(grasp: Grasp) -> np.ndarray:
        along = 0.04 * np.array([math.cos(grasp.theta), math.sin(grasp.theta)])
        middle = WORKSPACE.to_world([grasp.u, grasp.v])
        return np.stack([middle - along, middle + along])

    moved, expected = tips(WORKSPACE.move_grasp(g, grasp)), g(tips(grasp))
    either_way = min(np.abs(moved - expected).max(), np.abs(moved[::-1] - expected).max())
    assert either_way < 1e-9


def blob(grasp: Grasp) -> Observation:
    """A long Gaussian hill along the grasp's closing axis: it can be drawn anywhere without resampling."""
    v, u = np.mgrid[:160, :320]
    x, y = np.moveaxis(WORKSPACE.to_world(np.stack([u, v], axis=-1)), -1, 0)
    x0, y0 = WORKSPACE.to_world([grasp.u, grasp.v])
    c, s = math.cos(grasp.theta), math.sin(grasp.theta)
    along, across = (x - x0) * c + (y - y0) * s, (y - y0) * c - (x - x0) * s
    height = 0.1 * np.exp(-((along / 0.05) ** 2) - (across / 0.02) ** 2)
    color = np.repeat((2000 * height)[..., None], 3, axis=2)
    return Observation(color.astype(np.uint8), height.astype(np.float32))


near = st.builds(Motion, angles, st.floats(-0.05, 0.05), st.floats(-0.02, 0.02))
central = st.builds(Grasp, st.floats(140, 180), st.floats(70, 90), st.floats(0, math.pi))


@given(near, central)
def test_observation_and_grasp_move_together(g: Motion, grasp: Grasp) -> None:
    """T_g of the picture of a grasp is the picture of T_g of the grasp, up to interpolation."""
    moved = WORKSPACE.move_observation(g, blob(grasp))
    expected = blob(WORKSPACE.move_grasp(g, grasp))
    assert np.abs(moved.height - expected.height).max() < 0.003
    assert np.abs(moved.color.astype(int) - expected.color.astype(int)).max() < 8


@given(motions, st.floats(-400, 400), st.floats(-400, 400))
def test_a_pixel_map_moves_pixels_as_the_motion_moves_points(g: Motion, u: float, v: float) -> None:
    mapped = WORKSPACE.pixel_map(g) @ [u, v, 1.0]
    assert mapped == pytest.approx([*WORKSPACE.to_pixel(g(WORKSPACE.to_world([u, v]))), 1.0], abs=1e-8)


scales = st.floats(0.01, 100)


@given(angles, angles, scales, scales, st.floats(-500, 500), st.floats(-500, 500))
def test_the_inverse_of_an_affine_map_is_linear_algebras(
    first: float, second: float, wide: float, high: float, u: float, v: float
) -> None:
    """Two turns with a stretch between them are every linear map that keeps the plane's side."""
    stretch = np.diag([wide, high, 1.0])
    affine = Motion(first, u, v).matrix() @ stretch @ Motion(second).matrix()
    expected = np.linalg.inv(affine)
    assert inverse(affine) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


@dataclass(frozen=True)
class UpsideDown(Workspace):
    """Broken: rows grow with y."""

    def to_pixel(self, points: ArrayLike) -> np.ndarray:
        u, v = np.moveaxis(super().to_pixel(points), -1, 0)
        return np.stack([u, self.rows - 1 - v], axis=-1)


def test_a_flipped_axis_breaks_the_laws() -> None:
    broken, g, grasp = UpsideDown(), Motion(0.4, 0.03, 0.01), Grasp(150, 70, 0.3)
    assert not close(broken.move_grasp(g, grasp), WORKSPACE.move_grasp(g, grasp), pixels=1.0)
    moved = WORKSPACE.move_observation(g, blob(grasp))
    assert np.abs(moved.height - blob(broken.move_grasp(g, grasp)).height).max() > 0.02


def test_moving_by_whole_pixels_copies_bits() -> None:
    rng = np.random.default_rng(0)
    before = Observation(rng.integers(0, 255, (160, 320, 3), dtype=np.uint8), rng.random((160, 320), dtype=np.float32))
    after = WORKSPACE.move_observation(Motion(0, 5 * WORKSPACE.pixel, -3 * WORKSPACE.pixel), before)
    assert np.array_equal(after.height[3:, 5:], before.height[:-3, :-5])
    assert np.array_equal(after.color[3:, 5:], before.color[:-3, :-5])
    half = WORKSPACE.move_observation(Motion(math.pi), before)
    assert np.allclose(half.height, before.height[::-1, ::-1], atol=1e-5)


def test_what_comes_in_from_outside_is_table() -> None:
    color = np.full((160, 320, 3), 52, dtype=np.uint8)
    moved = WORKSPACE.move_observation(Motion(0.3, 0.2, 0.1), Observation(color, np.zeros((160, 320), np.float32)))
    assert (moved.color == 52).all()
    assert (moved.height == 0).all()


def test_warp_keeps_the_dtype_and_fills() -> None:
    moved = warp(np.ones((4, 4), np.float32), np.eye(3), (6, 6), -1.0)
    assert moved.dtype == np.float32
    assert (moved[:4, :4] == 1).all()
    assert (moved[4:] == -1).all()


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.booleans())
def test_the_tables_colour_is_the_median_of_what_is_bare(seed: int, columns: int, covered: bool) -> None:
    rng = np.random.default_rng(seed)
    color = rng.integers(0, 256, (3, columns, 3), dtype=np.uint8)
    height = rng.choice([0.0, 0.05], (3, columns)).astype(np.float32) + np.float32(0.1 * covered)
    bare = color[height < 0.002] if (height < 0.002).any() else color.reshape(-1, 3)
    expected = np.median(bare, axis=0).astype(np.uint8)
    assert np.array_equal(table_color(Observation(color, height)), expected)


@pytest.mark.parametrize("level", [0.003, -0.003])
def test_what_is_off_the_table_by_millimetres_is_not_its_colour(level: float) -> None:
    """A table off 0 by a millimetre or a little more, as cameras see one, mostly under a sheet of white."""
    rng = np.random.default_rng(0)
    height = (rng.choice([-1, 1], (100, 200)) * rng.uniform(0.001, 0.0015, (100, 200))).astype(np.float32)
    color = np.full((100, 200, 3), 140, np.uint8)
    color[:2], height[:2] = 20, 0.0
    color[30:], height[30:] = 255, level
    assert table_color(Observation(color, height)).tolist() == [140, 140, 140]


def glimpse(share: float, table: int, level: float = 0.0) -> Observation:
    """A table of one grey of which cameras saw so much, with something white on it; metres."""
    color = np.full((100, 200, 3), table, np.uint8)
    height = np.full((100, 200), level, np.float32)
    color[20:40, 3:13], height[20:40, 3:13] = 255, level + 0.05
    unseen = np.s_[:, round(200 * share) :]
    color[unseen], height[unseen] = 0, 0.0
    return Observation(color, height)


@pytest.mark.parametrize("level", [0.0, 0.006])
@pytest.mark.parametrize("share", [0.25, 0.37, 0.45, 0.65, 1.0])
def test_the_tables_colour_is_that_of_what_was_seen_of_it(share: float, level: float) -> None:
    """However little: what no camera saw is black, and was more than half of it."""
    assert table_color(glimpse(share, 140, level)).tolist() == [140, 140, 140]


def test_a_black_table_is_black() -> None:
    """What stands on it is then all that is not as what was never seen, and a small part."""
    assert table_color(glimpse(1.0, 0)).tolist() == [0, 0, 0]


def test_records_refuse_what_is_not_one() -> None:
    with pytest.raises(ValueError, match="theta is nan"):
        Grasp(1, 2, math.nan)
    with pytest.raises(ValueError, match="uint8"):
        Observation(np.zeros((4, 4, 3), np.float32), np.zeros((4, 4), np.float32))  # ty: ignore
    with pytest.raises(ValueError, match="float32"):
        Observation(np.zeros((4, 4, 3), np.uint8), np.zeros((5, 4), np.float32))
    with pytest.raises(ValueError, match="square pixels"):
        Workspace(length=2.0)


def test_a_closing_axis_has_no_direction() -> None:
    assert Grasp(0, 0, math.pi + 0.2).theta == pytest.approx(0.2)
    assert Grasp(0, 0, -1e-18).theta == 0.0
