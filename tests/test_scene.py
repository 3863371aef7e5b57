"""What must hold of objects at rest and of a hand that comes down on one."""

import gc
import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pybullet
import pytest

from equigrasp.grasp import Grasp, Observation
from equigrasp.hand import HAND
from equigrasp.workspace import WORKSPACE, Motion
from tasks.arrangement import LEAST_CLEARANCE, arrange
from tasks.env import GraspEnv
from tasks.gripper import Gripper, Reach, reach
from tasks.judge import RISE
from tasks.objects import OBJECTS, load
from tasks.scene import Client, Scene


@pytest.fixture(scope="module")
def bullet() -> Iterator[Client]:
    client = Client()
    yield client
    client.disconnect()


def sunk(bullet: Client) -> float:
    """The law: nothing is pressed into the table. How far the corners of a block get below it, metres, at the worst.

    Bullet itself lets a corner under the fingers in by a few millimetres.
    """
    deepest = 0.0
    for offset, theta in ((0.02, 0.3), (0.035, 0.1), (0.04, 0.0)):
        scene = Scene(bullet, [load("block-star")], [Motion()])
        [name] = scene.bodies
        start = scene.pose(name).position
        heights = []
        scene.grasp(
            Reach(start[0] + offset, start[1], theta, start=0.1, tip=HAND.floor),
            lambda _, scene=scene, name=name, heights=heights: heights.append(scene.pose(name).position[2]),
        )
        deepest = max(deepest, float(start[2] - min(heights)))
    return deepest


def test_the_hand_does_not_press_an_object_into_the_table(bullet: Client) -> None:
    assert sunk(bullet) < 0.006


def test_a_hand_that_goes_on_pressing_breaks_the_law(bullet: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def approach(hand: Gripper, to: Reach) -> None:
        hand._place(to.x, to.y, to.start, to.theta)
        hand._move(to.tip, speed=0.5)

    monkeypatch.setattr(Gripper, "approach", approach)
    assert sunk(bullet) > 0.01


def test_what_is_not_touched_stays_to_the_last_bit(bullet: Client) -> None:
    assets = [load(name) for name in ("lion", "apple", "mug")]
    scene = Scene(bullet, assets, [Motion(x=-0.2), Motion(x=0.1), Motion(x=0.3)])
    before = {name: scene.pose(name) for name in scene.bodies}
    target = before["apple"].position
    lifted, touched = scene.grasp(Reach(target[0], target[1], 0.0, start=0.15, tip=0.02))
    assert lifted == ["apple"]
    assert set(touched) == {"apple"}
    scene.put_down()
    for name in ("lion", "mug"):
        after = scene.pose(name)
        assert (after.position == before[name].position).all()
        assert (after.rotation == before[name].rotation).all()
    assert (scene.pose("apple").position != target).any()


def raised(
    bullet: Client, monkeypatch: pytest.MonkeyPatch, name: str, along: float, lift: float, force: float
) -> tuple[bool, float, bool, bool]:
    """Grasp an object so far along its length, by so much and so hard: held, by how much it rose, on the table, lifted.

    Lengths in metres, force in newtons.
    """
    monkeypatch.setattr("tasks.gripper.LIFT", lift)
    monkeypatch.setattr("tasks.gripper.FORCE", force)
    scene = Scene(bullet, [load(name)], [Motion()])
    outline = scene.asset(name).footprint
    start = scene.pose(name).position
    # across the length, at the middle of what is there
    y = start[1] + outline[np.abs(outline[:, 0] - along) < 0.01, 1].mean()
    lifted, _ = scene.grasp(Reach(start[0] + along, y, np.pi / 2, start=0.15, tip=HAND.floor))
    body = scene.bodies[name]
    held = body in {contact.body for contact in scene.gripper.contacts()}
    rise = scene.pose(name).position[2] - start[2]
    # the table is a scene's first body
    return held, float(rise), bool(bullet.getContactPoints(bodyA=body, bodyB=0)), bool(lifted)


def test_what_is_held_and_raised_a_little_is_not_lifted(bullet: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    held, rise, on_the_table, lifted = raised(bullet, monkeypatch, "knife", along=0.0, lift=0.02, force=20)
    assert held
    assert not on_the_table
    assert 0.01 < rise < RISE
    assert not lifted
    assert raised(bullet, monkeypatch, "knife", along=0.0, lift=0.15, force=20)[-1]


def test_what_is_raised_by_one_end_alone_is_not_lifted(bullet: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hand that is too weak to keep it level holds a hammer by its end; the other end stays on the table."""
    held, rise, on_the_table, lifted = raised(bullet, monkeypatch, "mini-claw-hammer", along=-0.06, lift=0.1, force=3)
    assert held
    assert on_the_table
    assert rise > RISE
    assert not lifted
    assert raised(bullet, monkeypatch, "mini-claw-hammer", along=-0.06, lift=0.15, force=20)[-1]


def test_what_flies_and_is_not_held_is_not_lifted(bullet: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """As what slips out of the fingers with a jerk: high above the table, and in nobody's hand."""
    scene = Scene(bullet, [load("apple"), load("lemon")], [Motion(), Motion(x=0.2)])
    start = scene.pose("apple").position
    lift = Gripper.lift

    def lift_and_throw(hand: Gripper) -> None:
        lift(hand)
        bullet.resetBasePositionAndOrientation(scene.bodies["lemon"], [0.2, 0.1, 0.3], [0, 0, 0, 1])
        # what is awake forgets its contact with the table at the next step
        bullet.changeDynamics(scene.bodies["lemon"], -1, activationState=pybullet.ACTIVATION_STATE_WAKE_UP)
        bullet.stepSimulation()

    monkeypatch.setattr(Gripper, "lift", lift_and_throw)
    lifted, _ = scene.grasp(Reach(start[0], start[1], 0.0, start=0.15, tip=0.02))
    assert scene.pose("lemon").position[2] > 0.25
    assert lifted == ["apple"]


def test_an_object_wakes_when_it_is_pushed(bullet: Client) -> None:
    scene = Scene(bullet, [load("lemon")], [Motion()])
    start = scene.pose("lemon").position
    # one finger comes down on its flank
    scene.grasp(Reach(start[0], start[1] + 0.065, np.pi / 2, start=0.15, tip=0.01))
    scene.put_down()
    assert np.hypot(*(scene.pose("lemon").position - start)[:2]) > 0.005


def moved(bullet: Client, clearance: float) -> float:
    """How far the furthest of five objects in 25 scenes was pushed along the table, metres, when all came to rest."""
    furthest = 0.0
    names = sorted(OBJECTS)
    for seed in range(25):
        rng = np.random.default_rng(seed)
        assets = [load(names[index]) for index in rng.permutation(len(names))[:5]]
        poses = arrange(assets, rng, clearance)
        scene = Scene(bullet, assets, poses)
        for asset, put in zip(assets, poses, strict=True):
            furthest = max(furthest, float(np.hypot(*(scene.pose(asset.name).position[:2] - [put.x, put.y]))))
    return furthest


def test_what_is_laid_out_stays_where_it_is_put(bullet: Client) -> None:
    for clearance in (LEAST_CLEARANCE, 0.002, 0.012):
        assert moved(bullet, clearance) < 0.001


def test_what_is_laid_out_nearer_is_pushed_away_and_refused(bullet: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    sentence = "clearance is metres between two objects, a number from 0.001, but this is 0"
    with pytest.raises(ValueError, match=sentence):
        moved(bullet, 0)
    scene = Scene(bullet, [load("lemon")], [Motion()])
    with pytest.raises(ValueError, match=sentence):
        scene.turn("lemon", 1.0, clearance=0)
    monkeypatch.setattr("tasks.arrangement.LEAST_CLEARANCE", 0.0)
    assert moved(bullet, 0.0) > 0.005


def test_things_are_laid_out_in_every_direction_and_clear_of_the_edge() -> None:
    """The fingers beside a thing are inside the workspace too."""
    (x_min, x_max), (y_min, y_max) = WORKSPACE.bounds
    [fork] = assets = [load("fork")]
    rng = np.random.default_rng(0)
    quarters, nearest = set(), np.inf
    for _ in range(200):
        [pose] = arrange(assets, rng, LEAST_CLEARANCE)
        outline = pose(fork.footprint)
        nearest = min(nearest, *(outline - [x_min, y_min]).min(axis=0), *([x_max, y_max] - outline).min(axis=0))
        quarters.add(int(pose.angle % (2 * np.pi) // (np.pi / 2)))
    assert quarters == {0, 1, 2, 3}
    assert 0.02 <= nearest < 0.03


def test_the_hand_comes_down_from_above_what_is_near_and_never_into_the_table() -> None:
    height = np.zeros(WORKSPACE.shape, dtype=np.float32)
    seen = Observation(np.zeros((*WORKSPACE.shape, 3), dtype=np.uint8), height)
    on_table = reach(Grasp(100, 80, 0.5), seen)
    assert (*WORKSPACE.to_pixel([on_table.x, on_table.y]), on_table.theta) == pytest.approx((100, 80, 0.5))
    assert on_table.tip == HAND.floor
    height[80, 100] = 0.06
    assert reach(Grasp(100, 80, 0.5), seen).tip == pytest.approx(0.06 - HAND.depth)
    beside = round(0.1 / WORKSPACE.pixel)
    height[80, 100 + beside] = 0.12
    assert reach(Grasp(100, 80, 0.5), seen).start > 0.12
    height[80, 100 + 2 * beside] = 0.2
    assert reach(Grasp(100, 80, 0.5), seen).start < 0.2, "what is far away is not under the hand"


def connected() -> set[int]:
    """Numbers of the clients that PyBullet has now."""
    gc.collect()
    return {number for number in range(1024) if pybullet.isConnected(number)}


def test_an_environment_that_nobody_has_any_more_leaves_no_client() -> None:
    before = connected()
    for seed in range(3):
        env = GraspEnv("pick-fruit", camera="overhead")
        env.reset(seed=seed)
    assert len(connected() - before) == 1, "the last one lives"
    assert env.started()[1].bodies
    del env
    assert connected() == before


def test_a_client_that_was_disconnected_does_not_take_the_next_one_with_it() -> None:
    """PyBullet gives a number again that is free."""
    first = Client()
    first.disconnect()
    second = Client()
    before = connected()
    first.disconnect()
    del first
    assert connected() == before
    second.stepSimulation()
    second.disconnect()
    assert len(connected()) == len(before) - 1


def test_a_forked_process_leaves_its_parents_client_alone() -> None:
    env = GraspEnv("pick-fruit", camera="overhead")
    env.reset(seed=0)
    height = env.observation.height.copy()
    child = os.fork()
    if child == 0:
        del env
        gc.collect()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    grasp = env.oracle()[0]
    assert np.array_equal(env.observation.height, height)
    assert env.attempt(grasp).success
    env.close()


def test_a_client_that_lives_when_the_interpreter_ends_says_nothing() -> None:
    lines = "from tasks.env import GraspEnv; env = GraspEnv('pick-fruit', camera='overhead'); env.reset(seed=0)"
    ended = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True)
    assert ended.returncode == 0
    assert "Exception" not in ended.stderr
