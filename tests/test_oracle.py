import dataclasses
import math

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from equigrasp.grasp import Grasp
from equigrasp.workspace import WORKSPACE, Motion
from tasks import TASKS
from tasks.env import GraspEnv
from tasks.oracle import FREE, GOAL, OTHER, Truth, _rate, best_grasps

GOALS = TASKS["pick-by-part"].goals


def bar(angle=0.0, x=0.0, y=0.0, length=0.12, width=0.024, height=0.03) -> Truth:
    """A bar on a bare table, its length along `angle`; the whole of it is the part."""
    u, v = np.meshgrid(np.arange(WORKSPACE.columns), np.arange(WORKSPACE.rows))
    local = Motion(angle, x, y).inverse()(WORKSPACE.to_world(np.stack([u, v], axis=-1)))
    mine = (np.abs(local) <= [length / 2, width / 2]).all(axis=-1)
    return Truth(
        np.where(mine, height, 0.0).astype(np.float32), np.where(mine, GOAL, FREE).astype(np.int8), mine, (x, y)
    )


def turn_between(first: float, second: float) -> float:
    """The angle between two closing axes, radians, at most a right angle."""
    return abs((first - second + math.pi / 2) % math.pi - math.pi / 2)


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.2, 2.0, 2.9])
def test_a_bar_is_taken_across_its_middle(angle):
    grasp, score = best_grasps(bar(angle, 0.1, -0.05))[0]
    assert turn_between(grasp.theta, angle + math.pi / 2) <= math.radians(7.5)
    x, y = WORKSPACE.to_world([grasp.u, grasp.v])
    assert math.hypot(x - 0.1, y + 0.05) < 0.025
    assert score > 0.5


def test_it_takes_the_part_that_was_asked_for():
    truth = bar()
    columns = np.arange(WORKSPACE.columns)[None, :]
    right = dataclasses.replace(truth, on_part=truth.on_part & (columns > 165))
    assert best_grasps(right)[0][0].u > 165
    assert best_grasps(truth)[0][0].u < 165


def test_a_grasp_with_more_of_the_part_between_the_fingers_is_the_better_one() -> None:
    """The same grasp, of a part that has less of what the fingers sweep and is as much where they meet it."""
    truth = bar()
    v, u = np.indices(WORKSPACE.shape)
    [(grasp, score)] = best_grasps(dataclasses.replace(truth, on_part=truth.on_part & (abs(u - 159.5) < 8)))
    assert turn_between(grasp.theta, math.pi / 2) < 1e-9
    hollow = truth.on_part & (abs(u - 159.5) < 8) & ~((abs(v - 79.5) < 3) & (abs(v - 79.5) > 1))
    [(same, less)] = best_grasps(dataclasses.replace(truth, on_part=hollow))
    # the bar is its own mirror image, and so are its two middle pixels
    assert (abs(same.u - 159.5), same.v, same.theta) == (abs(grasp.u - 159.5), grasp.v, grasp.theta)
    assert less < 0.75 * score


def test_fingers_that_do_not_meet_opposite_each_other_twist_what_they_hold() -> None:
    """Two fingers on half of the lines each, as far apart and as far from the middle, and only not on the same ones."""

    def rated(left: range, right: range) -> float:
        edges = np.zeros((9, 4))
        edges[:, 0], edges[:, 1], edges[:, 2:] = -0.015, 0.015, 1.0
        edges[left, 0], edges[right, 1] = -0.02, 0.02
        return _rate(edges)[0]

    opposite, a_little, far = rated(range(5), range(5)), rated(range(5), range(1, 6)), rated(range(5), range(4, 9))
    assert rated(range(1, 6), range(5)) == pytest.approx(a_little)
    assert opposite > a_little > far
    assert far < 0.5 * opposite


def test_the_further_from_the_centre_of_mass_the_worse() -> None:
    """The same part and the same grasp; what else the object has weighs more on one side."""
    scores = [best_grasps(dataclasses.replace(bar(), center=(x, 0.0)))[0][1] for x in (0.0, 0.05, 0.1, 0.15)]
    assert scores == sorted(scores, reverse=True)
    assert scores[-1] < 0.9 * scores[0]


def test_few_lines_between_the_fingers_are_worse_than_many_and_a_wide_thing_than_a_narrow_one() -> None:
    def rated(lines: range, half_width: float) -> float:
        edges = np.tile([np.inf, -np.inf, 0.0, 0.0], (9, 1))
        edges[lines] = -half_width, half_width, 1.0, 1.0
        return _rate(edges)[0]

    assert rated(range(9), 0.015) > rated(range(2, 7), 0.015) > rated(range(4, 5), 0.015)
    assert rated(range(4, 5), 0.015) < 0.7 * rated(range(9), 0.015)
    assert rated(range(9), 0.037) < 0.2 * rated(range(9), 0.03)


def test_grasps_to_try_are_good_for_something_best_first_and_no_two_alike() -> None:
    found = best_grasps(bar(0.3), 10**4)
    assert 10 < len(found) < 10**3
    scores = [score for _, score in found]
    assert scores == sorted(scores, reverse=True)
    assert scores[-1] > 0
    for place, (grasp, _) in enumerate(found):
        for other, _ in found[:place]:
            apart = math.hypot(grasp.u - other.u, grasp.v - other.v) * WORKSPACE.pixel
            assert apart >= 0.01 or turn_between(grasp.theta, other.theta) > math.radians(10)


def test_where_nothing_is_free_it_takes_what_is_least_in_the_way() -> None:
    """Posts all about the bar, two pixels from it: a few of them under the hand are better than a fence of them."""
    truth = bar()
    v, u = np.indices(WORKSPACE.shape)

    def among(posts: np.ndarray) -> list[tuple[Grasp, float]]:
        ring = binary_dilation(truth.on_part, iterations=3) & ~binary_dilation(truth.on_part, iterations=2) & posts
        height = np.where(ring, np.float32(0.032), truth.height)
        owner = np.where(ring, np.int8(OTHER), truth.owner)
        return best_grasps(dataclasses.replace(truth, height=height, owner=owner), 3)

    few, more, all_of_them = among((u + v) % 8 == 0), among((u + v) % 2 == 0), among(np.ones_like(truth.on_part))
    assert len(few) == len(more) == 3
    assert 0.2 > few[0][1] > more[0][1] > 0
    assert [score for _, score in all_of_them] == [0.0]


def test_it_keeps_away_from_a_neighbour():
    truth = bar()
    height, owner = truth.height.copy(), truth.owner.copy()
    # a wall along the left half of the bar, closer than a finger is thick
    height[66:73, 135:162], owner[66:73, 135:162] = 0.03, OTHER
    crowded = dataclasses.replace(truth, height=height, owner=owner)
    free, score = best_grasps(truth)[0]
    grasp, crowded_score = best_grasps(crowded)[0]
    assert grasp.u > free.u
    assert crowded_score < score
    height[60:100, 130:190] = np.where(truth.on_part[60:100, 130:190], 0.03, 0.032)
    owner[60:100, 130:190] = np.where(truth.on_part[60:100, 130:190], GOAL, OTHER)
    assert best_grasps(dataclasses.replace(truth, height=height, owner=owner))[0][1] < 0.2


def test_what_is_out_of_sight_scores_nothing():
    truth = dataclasses.replace(bar(x=0.2), on_part=np.zeros(WORKSPACE.shape, dtype=bool))
    grasp, score = best_grasps(truth)[0]
    assert score == 0.0
    assert WORKSPACE.to_world([grasp.u, grasp.v]) == pytest.approx([0.2, 0.0])


def test_an_object_that_left_the_table_costs_a_trial_and_no_more():
    env = GraspEnv(camera="overhead")
    env.reset(seed=3)
    bullet, scene = env.started()
    body = scene.bodies[env.goal.object]
    _, orientation = bullet.getBasePositionAndOrientation(body)
    bullet.resetBasePositionAndOrientation(body, [0.7, -0.4, 0.05], orientation)
    grasp, score = env.oracle()
    assert (grasp.u, grasp.v, score) == (WORKSPACE.columns - 1, WORKSPACE.rows - 1, 0.0)
    assert env.attempt(grasp).reason == "nothing lifted"
    env.close()


def test_of_several_tries_it_gives_the_first_that_succeeds_and_the_best_where_none_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with GraspEnv(camera="overhead") as env:
        env.reset(seed=1002, options={"goal": 2})
        right, quality = env.oracle()
        before = env.started()[1].truth()
        beside = Grasp(right.u, right.v, right.theta + math.pi / 2)
        ranked = [(Grasp(2, 2, 0.0), 0.9), (right, 0.5), (beside, 0.1)]
        monkeypatch.setattr("tasks.env.best_grasps", lambda truth, count: ranked[:count])
        assert env.oracle(tries=1) == ranked[0]
        assert env.oracle(tries=3) == ranked[1]
        ranked.pop(1)
        assert env.oracle(tries=2) == ranked[0]
        assert env.started()[1].truth() == before
        assert quality > 0.5
        assert env.attempt(right).success


def test_each_goal_is_picked_at_the_first_try():
    """One scene for each of the 23 goals; a single miss is within what the oracle is allowed."""
    env = GraspEnv(camera="overhead")
    outcomes = {}
    for index, goal in enumerate(GOALS):
        env.reset(seed=1000 + index, options={"goal": index})
        outcomes[goal] = env.attempt(env.oracle()[0])
    env.close()
    missed = {str(goal): outcome.reason for goal, outcome in outcomes.items() if not outcome.success}
    assert len(missed) <= 1, missed


def test_it_is_the_oracle_that_is_good_and_not_the_judge_that_is_kind():
    """The same pixel with the closing axis turned by a right angle fails often."""
    env = GraspEnv(camera="overhead")
    successes = 0
    asked = range(0, len(GOALS), 2)
    for index in asked:
        env.reset(seed=1000 + index, options={"goal": index})
        grasp, _ = env.oracle()
        successes += env.attempt(Grasp(grasp.u, grasp.v, grasp.theta + math.pi / 2)).success
    env.close()
    assert successes < 0.7 * len(asked)
