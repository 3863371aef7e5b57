from dataclasses import replace

import numpy as np
import pybullet
import pytest
from scipy import ndimage

from equigrasp.grasp import Observation
from equigrasp.workspace import WORKSPACE
from tasks import camera
from tasks.env import GraspEnv
from tasks.scene import Client

BOXES = [((-0.31, 0.12), (0.03, 0.05, 0.04)), ((0.22, -0.17), (0.06, 0.02, 0.09)), ((0.40, 0.15), (0.02, 0.02, 0.02))]
"""x, y of the centre and full sizes, metres; nothing symmetrical about them."""


@pytest.fixture(scope="module")
def boxes():
    bullet = Client()
    for (x, y), sizes in BOXES:
        shape = bullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=[side / 2 for side in sizes], rgbaColor=[1, 0, 0, 1]
        )
        bullet.createMultiBody(0, -1, shape, [x, y, sizes[2] / 2])
    yield bullet
    bullet.disconnect()


def views(bullet):
    return {"overhead": camera.overhead(bullet)[0], "fused": camera.fused(bullet)}


def misregistration(seen: Observation) -> float:
    """The law: each box stands at Workspace.to_pixel of its centre. Returns the worst distance in pixels."""
    regions, count = ndimage.label(seen.height > 0.01)
    if count != len(BOXES):
        return np.inf
    centers = np.array(ndimage.center_of_mass(np.ones(seen.shape), regions, range(1, count + 1)))[:, ::-1]
    places = WORKSPACE.to_pixel([center for center, _ in BOXES])
    return max(np.hypot(*(centers - place).T).min() for place in places)


@pytest.mark.parametrize("kind", ["overhead", "fused"])
def test_boxes_stand_where_the_workspace_says(boxes, kind):
    assert misregistration(views(boxes)[kind]) < 0.8


@pytest.mark.parametrize("kind", ["overhead", "fused"])
def test_broken_cameras_break_the_law_of_registration(boxes, kind):
    seen = views(boxes)[kind]
    broken = {
        "rows upside down": Observation(seen.color[::-1], seen.height[::-1]),
        "columns mirrored": Observation(seen.color[:, ::-1], seen.height[:, ::-1]),
        "two pixels to the side": Observation(np.roll(seen.color, 2, 1), np.roll(seen.height, 2, 1)),
        "not a height": Observation(seen.color, 0.005 - 0.01 * seen.height),
    }
    for name, observation in broken.items():
        assert misregistration(observation) > 1.0, name


@pytest.mark.parametrize("kind", ["overhead", "fused"])
def test_heights_are_exact_within_a_millimetre(boxes, kind):
    seen = views(boxes)[kind]
    for center, (*_, top) in BOXES:
        u, v = np.rint(WORKSPACE.to_pixel(center)).astype(int)
        patch = seen.height[v - 1 : v + 2, u - 1 : u + 2]
        assert np.abs(patch - top).max() < 0.001
    assert np.abs(seen.height[seen.height < 0.01]).max() < 0.001


def test_the_renderer_looks_through_the_middle_of_each_pixel(boxes):
    """TinyRenderer does not, by itself: a box covers exactly the pixels whose centres it covers."""
    u, v = np.meshgrid(np.arange(WORKSPACE.columns), np.arange(WORKSPACE.rows))
    points = WORKSPACE.to_world(np.stack([u, v], axis=-1))
    covered = np.zeros(WORKSPACE.shape, dtype=bool)
    for center, sizes in BOXES:
        covered |= (np.abs(points - center) <= np.array(sizes[:2]) / 2).all(axis=-1)
    seen = camera.overhead(boxes)[0].height > 0.01
    edge = ndimage.binary_dilation(covered) & ~ndimage.binary_erosion(covered)
    assert not (seen ^ covered)[~edge].any()
    assert (seen ^ covered).sum() <= 0.02 * edge.sum()
    assert (np.roll(covered, 1, axis=1) ^ covered).sum() > 0.2 * edge.sum()


def test_both_cameras_see_the_same_silhouettes():
    env = GraspEnv(camera="overhead")
    env.reset(seed=4)
    above, around = (view.height > 0.004 for view in views(env._bullet).values())
    near = np.ones((3, 3))
    # what either sees, the other sees within a pixel; but thin rims may go under from one side
    assert (above & ~ndimage.binary_dilation(around, near)).mean() < 1e-4
    assert (around & ~ndimage.binary_dilation(above, near)).mean() < 1e-4
    shifted = np.roll(around, 3, axis=0)
    assert (shifted & ~ndimage.binary_dilation(above, near)).mean() > 1e-3
    env.close()


def turned_shading(viewpoint: camera.Viewpoint) -> float:
    """How far a scene turned by 180 degrees looks from its turned picture: mean difference of colour on objects."""
    env = GraspEnv(camera="overhead")
    env.reset(seed=4)
    bullet, _ = env.started()
    before, _, owner = camera.shoot(bullet, viewpoint)
    for body in range(bullet.getNumBodies()):
        position, orientation = bullet.getBasePositionAndOrientation(body)
        turn = pybullet.getQuaternionFromEuler([0, 0, np.pi])
        bullet.resetBasePositionAndOrientation(
            body, *pybullet.multiplyTransforms([0, 0, 0], turn, position, orientation)
        )
    after = camera.shoot(bullet, viewpoint)[0]
    env.close()
    inside = ndimage.binary_erosion(owner[::-1, ::-1] != camera.TABLE, iterations=2)
    return float(np.abs(after.astype(float) - before[::-1, ::-1])[inside].mean())


def test_shading_turns_with_the_scene_and_would_not_under_a_slanting_light():
    viewpoint = camera.overhead_viewpoint()
    assert turned_shading(viewpoint) < 2
    assert turned_shading(replace(viewpoint, light=(0.3, -0.4, 1.0))) > 5


def test_pictures_are_the_same_each_time(boxes):
    first, second = views(boxes), views(boxes)
    assert all(first[kind].same(second[kind]) for kind in first)


def test_segmentation_says_whose_pixel_it_is(boxes):
    seen, segmentation = camera.overhead(boxes)
    assert (segmentation[seen.height == 0.0] == camera.TABLE).all()
    for body, (center, _) in enumerate(BOXES):
        u, v = np.rint(WORKSPACE.to_pixel(center)).astype(int)
        assert segmentation[v, u] == body


def test_the_picture_for_humans_shows_the_table(boxes):
    picture = camera.portrait(boxes)
    assert picture.shape == (480, 640, 3)
    assert (picture == camera.TABLE_COLOR).all(axis=-1).mean() > 0.25
