import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from equigrasp.errors import InputError
from equigrasp.grasp import Observation
from equigrasp.heightmap import Camera, fuse
from equigrasp.workspace import WORKSPACE, Workspace, table_color, was_seen

INTRINSICS = np.array([[400.0, 0.0, 159.5], [0.0, 400.0, 119.5], [0.0, 0.0, 1.0]])


def looking_down(x=0.0, y=0.0, z=1.0, turn=0.0):
    """Pose of a camera above (x, y) whose picture is turned by `turn` about the vertical."""
    c, s = np.cos(turn), np.sin(turn)
    pose = np.eye(4)
    pose[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = x, y, z
    return pose


def table(pose, color=(10, 20, 30), depth=None, size=(240, 320)):
    """A picture of the bare table from straight above."""
    image = np.broadcast_to(np.array(color, dtype=np.uint8), (*size, 3)).copy()
    return Camera(image, np.full(size, pose[2, 3] if depth is None else depth, np.float32), INTRINSICS, pose)


def see_point(camera, point, color):
    """Put one world point into a camera's picture, at the pixel that it projects to."""
    inside = np.linalg.inv(camera.pose) @ [*point, 1.0]
    i, j, depth = INTRINSICS @ inside[:3]
    i, j = round(i / depth), round(j / depth)
    camera.color[j, i] = color
    camera.depth[j, i] = depth


def test_a_point_lands_on_its_pixel_with_its_height_and_colour():
    for turn in (0.0, 0.7, 2.0):
        camera = table(looking_down(0.05, -0.03, 1.0, turn))
        see_point(camera, (0.1, 0.05, 0.06), (200, 0, 0))
        seen = fuse([camera])
        u, v = np.rint(WORKSPACE.to_pixel([0.1, 0.05])).astype(int)
        at = np.argwhere(seen.height > 0.03)
        assert len(at) == 1
        # the camera's own pixels are 2.5 mm on the table
        assert np.abs(at[0] - [v, u]).max() <= 1
        assert seen.height[tuple(at[0])] == pytest.approx(0.06, abs=1e-6)
        assert tuple(seen.color[tuple(at[0])]) == (200, 0, 0)


@given(
    st.integers(0, 319),
    st.integers(0, 159),
    st.floats(-0.45, 0.45),
    st.floats(-0.45, 0.45),
    st.floats(0.02, 0.2),
    st.floats(0, 6.2),
)
def test_a_point_lands_on_the_pixel_whose_centre_is_nearest(u, v, right, down, z, turn):
    """By a camera of one pixel, which sees the very point."""
    x, y = WORKSPACE.to_world([u + right, v + down])
    pose = looking_down(x, y, 1.0, turn)
    straight = np.array([[400.0, 0.0, 0.0], [0.0, 400.0, 0.0], [0.0, 0.0, 1.0]])
    camera = Camera(np.full((1, 1, 3), 200, np.uint8), np.full((1, 1), 1.0 - z, np.float32), straight, pose)
    seen = fuse([camera], gap=0)
    assert np.argwhere(seen.height > 0).tolist() == [[v, u]]
    assert seen.height[v, u] == pytest.approx(z, abs=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_height_that_is_not_finite_is_refused_with_one_sentence(value):
    seen = fuse([table(looking_down())])
    height = seen.height.copy()
    height[3, 4:6] = value
    with pytest.raises(InputError, match="but 2 of these are NaN or infinite; give what was not seen"):
        Observation(seen.color, height)


def test_the_highest_point_wins_whatever_the_order():
    low, high = table(looking_down()), table(looking_down(z=0.9), color=(90, 90, 90), depth=0.85)
    for cameras in ([low, high], [high, low]):
        seen = fuse(cameras)
        assert seen.height[80, 160] == pytest.approx(0.05, abs=1e-6)
        assert tuple(seen.color[80, 160]) == (90, 90, 90)


def test_what_was_not_read_is_ignored_and_so_is_what_is_above_the_ceiling():
    camera = table(looking_down())
    for depth in (0.0, np.nan, np.inf, -1.0, 0.5):
        camera.depth[:, :160] = depth
        seen = fuse([camera], gap=0)
        assert not seen.height.any()
        assert not seen.color[80, 100:155].any()
        assert (seen.color[80, 165:220] == (10, 20, 30)).all()
    assert fuse([camera], ceiling=0.6).height.max() == pytest.approx(0.5)


def test_what_seems_to_lie_below_the_table_lies_on_it() -> None:
    """A depth camera errs by a few millimetres, and the height of a bare table is 0."""
    camera = table(looking_down())
    camera.depth[:] = np.random.default_rng(0).normal(1.0, 0.004, camera.depth.shape).astype(np.float32)
    camera.depth[100:140, 140:180] = 1.03
    seen = fuse([camera])
    assert seen.height.min() == 0.0
    assert seen.height.max() > 0.005
    # what lies at 0 after all was seen, and keeps its colour
    assert (seen.height[70:90, 150:170] == 0).all()
    assert (seen.color[70:90, 150:170] == (10, 20, 30)).all()


MILLIMETRES = np.diag([1000.0, 1000.0, 1000.0, 1.0])
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("pose", "depth"),
    [
        (looking_down(), 0.0),
        (looking_down(), np.nan),
        (looking_down(), 0.5),
        (looking_down(), 1000.0),  # the one point straight below lies a kilometre under the table
        (looking_down() @ OPENGL, 1.0),
        (looking_down(z=1000.0), 1000.0),
        (np.linalg.inv(looking_down(x=2.0, turn=0.5)), 1.0),
        (looking_down(x=3.0), 1.0),
    ],
    ids=["unread", "NaN", "above the ceiling", "depth in mm", "OpenGL", "all in mm", "inverse", "beside the table"],
)
def test_a_table_that_no_point_falls_on_is_refused_with_the_usual_causes(pose, depth):
    for size in ((240, 320), (241, 321)):
        blind = table(pose, depth=depth, size=size)
        with pytest.raises(InputError, match=r"no point that was seen falls on the table, 1 m x 0\.5 m .*millimetres"):
            fuse([blind])
        # another camera sees it, and is heard alone
        assert fuse([blind, table(looking_down())]).color.any()


@pytest.mark.parametrize(
    ("intrinsics", "pose", "sentence"),
    [
        (INTRINSICS, looking_down() * np.nan, "pose are finite numbers"),
        (INTRINSICS + np.inf, looking_down(), "intrinsics are finite numbers"),
        (np.diag([-1.0, 1.0, 1.0]) @ INTRINSICS, looking_down(), "focal lengths are above 0 pixels"),
        (np.diag([1.0, 0.0, 1.0]) @ INTRINSICS, looking_down(), "focal lengths are above 0 pixels"),
        (INTRINSICS.T, looking_down(), "last row of a Camera's intrinsics is .* transposed"),
        (INTRINSICS, looking_down().T, "last row of a Camera's pose is .* transposed"),
        (INTRINSICS, looking_down() @ np.diag([1.0, -1.0, 1.0, 1.0]), "mirrors"),
        (INTRINSICS, np.diag([1.2, 1.2, 1.2, 1.0]) @ looking_down(), "have lengths 1.2, 1.2, 1.2"),
        (INTRINSICS, looking_down() @ MILLIMETRES, "have lengths 1e.03"),
        (INTRINSICS, looking_down() + np.eye(4, k=1) * [[0.1], [0], [0], [0]], "or lean"),
    ],
)
def test_a_calibration_that_no_camera_has_is_refused_with_one_sentence(intrinsics, pose, sentence):
    color, depth = np.zeros((4, 5, 3), np.uint8), np.ones((4, 5), np.float32)
    with pytest.raises(InputError, match=sentence):
        Camera(color, depth, intrinsics, pose)


@given(st.floats(0, 6.2), st.floats(-0.5, 0.5), st.sampled_from([3, 4, 7]))
def test_a_calibration_from_a_file_of_few_digits_will_do(turn, lean, digits):
    c, s = np.cos(lean), np.sin(lean)
    pose = looking_down(0.1, 0.2, 1.0, turn) @ np.block(
        [[np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), np.zeros((3, 1))], [np.zeros((1, 3)), 1.0]]
    )
    color, depth = np.zeros((4, 5, 3), np.uint8), np.ones((4, 5), np.float32)
    for written in (np.round(pose, digits), pose.astype(np.float32)):
        Camera(color, depth, INTRINSICS.astype(np.float32), written)


def test_small_holes_are_filled_from_the_low_side_and_wide_ones_stay_black():
    camera = table(looking_down())
    whole = fuse([camera])
    high = dataclasses.replace(camera, depth=camera.depth.copy(), color=camera.color.copy())
    high.depth[:, 160:] = 0.9
    high.color[:, 160:] = 250
    high.depth[:, 156:161] = 0.0
    assert (whole.color[80, 100:220] == (10, 20, 30)).all()
    narrow = fuse([high])
    assert (narrow.color[80, 100:220].max(axis=-1) > 0).all()
    step = int(np.argmax(narrow.height[80] > 0.05))
    assert tuple(narrow.color[80, step - 1]) == (10, 20, 30)
    wide = fuse([high], gap=0)
    assert not wide.color[80, step - 1].any()
    assert wide.height[80, step - 1] == 0.0


@pytest.mark.parametrize("step", [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1)])
def test_a_hole_between_two_points_is_filled_from_the_lower_one(step: tuple[int, int]) -> None:
    camera = table(looking_down(z=0.5), depth=0.0)
    middle = np.array([160, 80])
    for side, height, color in ((-1, 0.01, (10, 20, 30)), (1, 0.06, (250, 0, 0))):
        x, y = WORKSPACE.to_world(middle + side * np.array(step))
        see_point(camera, (x, y, height), color)
    assert np.count_nonzero(fuse([camera], gap=0).height) == 2
    filled = fuse([camera], gap=1)
    assert filled.height[80, 160] == pytest.approx(0.01)
    assert tuple(filled.color[80, 160]) == (10, 20, 30)


@pytest.mark.parametrize("z", [0.5, 0.7, 1.0])
def test_what_a_low_camera_did_not_see_has_no_say_in_the_tables_colour(z):
    camera = table(looking_down(z=z))
    see_point(camera, (0.1, 0.05, 0.06), (200, 0, 0))
    observation = fuse([camera])
    seen = was_seen(observation)
    assert seen.mean() < 0.97
    assert (observation.color[~seen] == 0).all()
    assert (observation.color[seen] > 0).all(axis=-1)[observation.height[seen] < 0.01].all()
    assert table_color(observation).tolist() == [10, 20, 30]


def test_another_workspace_may_be_filled():
    small = Workspace(length=0.2, depth=0.1, rows=20, columns=40)
    seen = fuse([table(looking_down())], small)
    assert seen.shape == (20, 40)
    assert (seen.color == (10, 20, 30)).all()


def test_wrong_pictures_are_refused_with_one_sentence():
    pose, color, depth = np.eye(4), np.zeros((4, 5, 3), np.uint8), np.ones((4, 5), np.float32)
    with pytest.raises(ValueError, match="color is"):
        Camera(color.astype(float), depth, INTRINSICS, pose)
    with pytest.raises(ValueError, match="depth is"):
        Camera(color, depth.astype(np.uint16), INTRINSICS, pose)  # ty: ignore[invalid-argument-type]
    with pytest.raises(ValueError, match="depth is"):
        Camera(color, depth[:3], INTRINSICS, pose)
    with pytest.raises(ValueError, match="pose is"):
        Camera(color, depth, INTRINSICS, pose[:3])
    with pytest.raises(ValueError, match="at least one camera"):
        fuse([])
