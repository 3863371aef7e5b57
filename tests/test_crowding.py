"""A hand is free where nothing is in its way; where something is, the nearest free grasp lifts what was asked for."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from equigrasp.augmentation import Augmentation, Example
from equigrasp.augmentation.canvas import Canvas
from equigrasp.augmentation.crowding import FURTHEST, MOST_TURNED, beside, nearest_free
from equigrasp.augmentation.cutouts import Cutout, take_apart
from equigrasp.grasp import Demonstration, Grasp
from equigrasp.hand import HAND, Hand, surface
from equigrasp.workspace import WORKSPACE, Motion
from tasks.env import GraspEnv
from tasks.oracle import FREE, GOAL, OTHER, best_grasps

TURN = math.radians(0.01)
"""Slack for sums of floats, radians."""


def heights(*boxes: tuple[int, int, int, int, float]) -> np.ndarray:
    """A heightmap with boxes: first and last row, first and last column, metres."""
    height = np.zeros(WORKSPACE.shape, dtype=np.float32)
    for top, bottom, left, right, metres in boxes:
        height[top:bottom, left:right] = metres
    return height


BAR = heights((76, 84, 130, 190, 0.02))
"""A bar along the columns, 2.5 cm wide and 19 long."""
MIDDLE = Grasp(160.0, 79.5, math.pi / 2)
"""Across its middle."""


def is_free(others: np.ndarray, grasp: Grasp, hand: Hand = HAND) -> bool:
    return bool(hand.is_free(BAR + others, others, np.array([[grasp.u, grasp.v, grasp.theta]]), WORKSPACE)[0])


def change(first: Grasp, second: Grasp) -> tuple[float, float]:
    """How far a grasp was put off, metres, and turned, radians."""
    turned = abs((first.theta - second.theta + math.pi / 2) % math.pi - math.pi / 2)
    return math.hypot(first.u - second.u, first.v - second.v) * WORKSPACE.pixel, turned


# The hand


@pytest.mark.parametrize(
    ("box", "free"),
    [
        ((100, 104, 158, 162, 0.02), True),  # beyond the fingers, below the palm
        ((100, 104, 158, 162, 0.06), False),  # and above it
        ((93, 96, 158, 162, 0.02), False),  # under a finger
        ((93, 96, 158, 162, 0.003), True),  # which stays above that
        ((93, 96, 170, 174, 0.02), True),  # beside a finger
        ((88, 90, 158, 162, 0.02), False),  # between the fingers
    ],
)
def test_what_is_in_the_way(box: tuple[int, int, int, int, float], free: bool) -> None:
    assert is_free(heights(box), MIDDLE) is free


@given(
    st.floats(120, 200), st.floats(60, 100), st.floats(0, 3.1), st.integers(0, 150), st.integers(0, 310), st.booleans()
)
def test_what_is_in_the_way_turns_with_the_scene(
    u: float, v: float, theta: float, top: int, left: int, tall: bool
) -> None:
    others = heights((top, top + 6, left, left + 6, 0.06 if tall else 0.02)) * (BAR == 0)
    grasp = Grasp(u, v, theta)
    turned = Grasp(WORKSPACE.columns - 1 - u, WORKSPACE.rows - 1 - v, theta + math.pi)
    both = [
        HAND.is_free(height, other, np.array([[each.u, each.v, each.theta]]), WORKSPACE)[0]
        for height, other, each in (
            (BAR + others, others, grasp),
            (np.rot90(BAR + others, 2), np.rot90(others, 2), turned),
        )
    ]
    assert both[0] == both[1]


def crowds(env: GraspEnv, seeds: range) -> list[tuple[bool, bool, bool]]:
    """Scenes in which something is in the way of the grasp that the oracle would choose for the target alone.

    Returns:
        Whether there is a free one near, whether that grasp succeeded, and whether the nearest free one did.
    """
    found = []
    for seed in seeds:
        env.reset(seed=seed)
        truth = env.truth()
        mine = truth.owner == GOAL
        alone = replace(truth, owner=np.where(mine, GOAL, FREE).astype(np.int8), height=truth.height * mine)
        wanted, _ = best_grasps(alone)[0]
        target = np.where(mine, env.observation.height, np.float32(0))
        free = nearest_free(HAND, env.observation.height, target, wanted, WORKSPACE)
        if free == wanted:
            continue
        outcomes = []
        for grasp in (wanted, free):
            env.reset(seed=seed)
            outcomes.append(grasp is not None and env.attempt(grasp).success)
        found.append((free is not None, outcomes[0], outcomes[1]))
    return found


def test_the_oracle_grasps_where_the_hand_is_free_and_not_where_it_is_wider(env: GraspEnv) -> None:
    wide = replace(HAND, opening=0.14)
    free = Counter()
    for seed in range(40):
        env.reset(seed=seed)
        truth = env.truth()
        others = np.where(truth.owner == OTHER, truth.height, np.float32(0))
        grasp, _ = best_grasps(truth)[0]
        pose = np.array([[grasp.u, grasp.v, grasp.theta]])
        for hand in (HAND, wide):
            free[hand] += int(hand.is_free(truth.height, others, pose, WORKSPACE)[0])
    assert free[HAND] == 40
    assert free[wide] < 40


def test_where_something_is_in_the_way_the_nearest_free_grasp_lifts_the_target() -> None:
    """In the simulator; and what it is put in place of does not, so that it was needed."""
    env = GraspEnv("pick-tool", camera="overhead")
    crowded = crowds(env, range(150))
    env.close()
    wanted, moved = zip(*(outcomes for there_is, *outcomes in crowded if there_is), strict=True)
    assert len(moved) >= 8
    assert np.mean(moved) >= 0.9
    assert sum(wanted) <= sum(moved) - 3


@given(st.integers(0, 319), st.integers(0, 159), st.floats(-0.49, 0.49), st.floats(-0.49, 0.49))
def test_the_height_at_a_grasp_is_that_of_the_nearest_pixel(u: int, v: int, right: float, down: float) -> None:
    height = np.random.default_rng(0).random(WORKSPACE.shape, dtype=np.float32)
    assert surface(height, np.array([[u + right, v + down, 0.3]]))[0] == height[v, u]
    turned = np.array([[319 - u - right, 159 - v - down, 0.3]])
    assert surface(np.rot90(height, 2), turned)[0] == height[v, u]


def test_outside_of_the_heightmap_its_edge_goes_on() -> None:
    height = np.random.default_rng(0).random(WORKSPACE.shape, dtype=np.float32)
    corners = np.array([[-9.0, -0.7, 0.0], [900.0, 400.0, 0.0]])
    assert surface(height, corners).tolist() == [height[0, 0], height[-1, -1]]


def test_the_fingers_close_on_what_stands_higher_than_their_tips() -> None:
    """On a wall's width, and not on that of the low step that it stands on; where there is nothing, on nothing."""
    wall, step = heights((76, 84, 130, 190, 0.06)), heights((70, 90, 130, 190, 0.01))
    pose = np.array([[MIDDLE.u, MIDDLE.v, MIDDLE.theta]])
    alone = HAND.section(wall, pose, WORKSPACE)
    assert alone[0] == pytest.approx([-0.0125, 0.0125, 0.06], abs=WORKSPACE.pixel)
    assert HAND.section(np.maximum(wall, step), pose, WORKSPACE) == pytest.approx(alone)
    assert HAND.section(step, pose, WORKSPACE)[0] == pytest.approx([-0.031, 0.031, 0.01], abs=WORKSPACE.pixel)
    assert np.isnan(HAND.section(np.zeros_like(wall), pose, WORKSPACE)[0, :2]).all()


# The nearest free grasp


def test_a_free_grasp_stays_what_it_is() -> None:
    assert nearest_free(HAND, BAR, BAR, MIDDLE, WORKSPACE) is MIDDLE


@given(st.integers(85, 100), st.integers(140, 176), st.sampled_from([0.02, 0.06]))
def test_the_nearest_free_grasp_is_free_and_near(top: int, left: int, metres: float) -> None:
    others = heights((top, top + 4, left, left + 4, metres))
    found = nearest_free(HAND, BAR + others, BAR, MIDDLE, WORKSPACE)
    if found is None:
        return
    assert is_free(others, found)
    off, turned = change(found, MIDDLE)
    assert off <= FURTHEST + 1e-9
    assert turned <= MOST_TURNED + TURN
    assert (found == MIDDLE) == is_free(others, MIDDLE)
    # the bar's other side has the same change, mirrored
    mirrored = nearest_free(HAND, np.flipud(BAR + others), BAR, MIDDLE, WORKSPACE)
    assert mirrored is not None
    assert change(mirrored, MIDDLE) == pytest.approx((off, turned), abs=1e-6)


def test_a_grasp_stays_on_a_section_like_its_own() -> None:
    """Where the bar is four times as wide beside its middle, the grasp may turn, but not go there."""
    others = heights((93, 96, 158, 162, 0.02))
    free = nearest_free(HAND, BAR + others, BAR, MIDDLE, WORKSPACE)
    assert free is not None
    wide = np.maximum(BAR, heights((64, 96, 130, 157, 0.02), (64, 96, 164, 190, 0.02)) * (others == 0))
    there = nearest_free(HAND, np.maximum(wide, others), wide, MIDDLE, WORKSPACE)
    assert there is None or change(there, MIDDLE)[0] < 0.013


def test_where_all_around_is_taken_there_is_none() -> None:
    wall = heights((60, 100, 110, 210, 0.02)) * (BAR == 0)
    assert nearest_free(HAND, BAR + wall, BAR, MIDDLE, WORKSPACE) is None


def test_beside_the_hand_is_under_it_on_both_sides() -> None:
    places = beside(HAND, MIDDLE, WORKSPACE)
    assert np.allclose(places.mean(axis=0), [MIDDLE.u, MIDDLE.v])
    for u, v in places:
        assert abs(u - MIDDLE.u) < 1e-9
        assert HAND.opening / 2 < abs(v - MIDDLE.v) * WORKSPACE.pixel < HAND.palm[0] / 2


# Crowded examples


def nothing_in_the_way(example: Example, demonstration: Demonstration) -> bool:
    """Whether the hand is free for the example's grasp, by the example's own heights."""
    scene = take_apart(replace(demonstration, observation=example.observation, grasp=example.grasp))
    height = example.observation.height
    target = np.zeros_like(height)
    left, top = scene.target.corner
    rows, columns = scene.target.mask.shape
    target[top : top + rows, left : left + columns] = scene.target.height
    pose = np.array([[example.grasp.u, example.grasp.v, example.grasp.theta]])
    return bool(HAND.is_free(height, np.where(target > 0, np.float32(0), height), pose, WORKSPACE)[0])


@pytest.mark.parametrize(("share", "least", "most"), [(1.0, 0.97, 1.0), (0.0, 0.7, 0.99)], ids=["crowded", "broken"])
def test_nothing_is_in_the_way_of_a_crowded_example(
    demonstrations: list[Demonstration], share: float, least: float, most: float
) -> None:
    """And something is in that of a few that are put together without regard to the hand."""
    augmentation = Augmentation(demonstrations, 1.0, 0.0, share)
    rng = np.random.default_rng(0)
    free = [nothing_in_the_way(augmentation.sample(rng), demonstrations[0]) for _ in range(150)]
    assert least <= np.mean(free) <= most


def test_crowded_scenes_are_crowded(demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch) -> None:
    """In more than a fourth of them something is in the demonstrated grasp's way, and the label is another."""
    put_off: dict[float, list[bool]] = {}

    def spy(hand: Hand, height: np.ndarray, target: np.ndarray, grasp: Grasp, *rest: object) -> Grasp | None:
        free = nearest_free(hand, height, target, grasp, WORKSPACE)
        put_off[augmentation.crowded].append(free is not grasp)
        return free

    monkeypatch.setattr("equigrasp.augmentation.augmentation.nearest_free", spy)
    for share in (0.01, 1.0):
        augmentation = Augmentation(demonstrations, 1.0, 0.0, share)
        put_off[share] = []
        rng = np.random.default_rng(0)
        for _ in range(80):
            augmentation.sample(rng)
    assert np.mean(put_off[1.0]) > 0.25 > 3 * np.mean(put_off[0.01])


def test_a_target_alone_is_never_in_its_own_way(demonstrations: list[Demonstration]) -> None:
    for demonstration in demonstrations:
        observation = demonstration.observation
        scene = take_apart(demonstration)
        left, top = scene.target.corner
        mask = np.zeros(observation.shape, bool)
        rows, columns = scene.target.mask.shape
        mask[top : top + rows, left : left + columns] = scene.target.mask > 0.5
        target = np.where(mask, observation.height, np.float32(0))
        assert nearest_free(HAND, target, target, demonstration.grasp, WORKSPACE) is demonstration.grasp


@pytest.mark.parametrize("kept", [True, False], ids=["what does not fit stands elsewhere", "broken"])
def test_a_crowded_scene_has_as_many_objects_as_another(
    demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch, kept: bool
) -> None:
    """Where nothing fits beside the hand, as where the target stands at the table's edge."""
    fits = Canvas.put

    def put(self: Canvas, cutout: Cutout, rng: np.random.Generator, near: np.ndarray | None = None) -> Motion | None:
        placed = fits(self, cutout, rng) if near is None and (kept or not found) else None
        found.append(placed)
        return placed

    monkeypatch.setattr(Canvas, "put", put)
    augmentation = Augmentation(demonstrations, 1.0, 0.0, 1.0)
    others = []
    for index, scene in enumerate(augmentation.scenes):
        found: list[Motion | None] = []
        augmentation.recombined(scene, np.random.default_rng(index))
        others.append(sum(each is not None for each in found) - 1 - len(scene.others))
    # some objects are too large for what is free of a full table
    assert (np.mean(others) > -0.5) == kept
