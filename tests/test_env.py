import hashlib
import json
import re
import subprocess
import sys
import warnings
from collections import Counter
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from equigrasp.grasp import Grasp
from equigrasp.workspace import WORKSPACE
from tasks import TASKS
from tasks.env import CLEARANCE, GraspEnv
from tasks.episode import EpisodeDraw
from tasks.goal import Goal
from tasks.judge import judge

GOALS = TASKS["pick-by-part"].goals


@pytest.fixture(scope="module")
def env():
    env = GraspEnv(camera="overhead")
    yield env
    env.close()


def corner(env) -> np.ndarray:
    """An action that grasps nothing: of the table's corners the one that is bare."""
    bare = [
        (u, v) for u in (4, 315) for v in (4, 155) if not env.observation.height[v - 4 : v + 5, u - 4 : u + 5].any()
    ]
    return np.array([*bare[0], 0])


def part_of_other(env, goal):
    """The goal's object by another part of its own."""
    return next(other for other in GOALS if other.object == goal.object and other.part != goal.part)


def oracle_for(env, goal) -> Grasp:
    """What the oracle would do if it had been asked for another goal."""
    asked = env._goals
    env._goals = (*asked[: env._done], goal, *asked[env._done + 1 :])
    grasp, _ = env.oracle()
    env._goals = asked
    return grasp


def fingerprint(env, seed, options=None) -> str:
    """Everything that an episode's first four trials show and do, to the last bit."""
    digest = hashlib.sha256()
    observation, info = env.reset(seed=seed, options=options)
    for _ in range(4):
        grasp, quality = env.oracle()
        digest.update(repr((grasp.u, grasp.v, grasp.theta, quality, observation["instruction"])).encode())
        digest.update(json.dumps(info, sort_keys=True).encode())
        digest.update(observation["color"].tobytes() + observation["height"].tobytes())
        # a try in vain in between, so that things get touched and put down
        action = WORKSPACE.to_action(grasp) if env._trials % 2 else np.array([int(grasp.u), int(grasp.v), 7])
        observation, reward, *_, info = env.step(action)
        digest.update(repr(reward).encode())
    return digest.hexdigest()


def test_the_oracle_picks_everything_for_a_reward_of_one(env):
    for seed in (0, 1):
        observation, info = env.reset(seed=seed)
        total, steps, over = 0.0, 0, False
        count = len(env._goals)
        assert 4 <= count <= 5
        assert info["trials_left"] == count + 1
        while not over:
            assert observation["instruction"] == env.instruction
            observation, reward, terminated, truncated, info = env.step(WORKSPACE.to_action(env.oracle()[0]))
            assert reward in (0.0, 1.0 / count)
            assert info["trials_left"] == count + 1 - (steps := steps + 1)
            total += reward
            over = terminated or truncated
        assert total == pytest.approx(1.0)
        assert terminated
        assert not truncated
        assert not observation["height"].any()


def test_n_plus_one_failures_truncate_the_episode_and_change_no_instruction(env):
    observation, info = env.reset(seed=2)
    action, first = corner(env), observation
    for trials_left in range(len(env._goals), -1, -1):
        assert not env.truncated
        observation, reward, terminated, truncated, info = env.step(action)
        assert (reward, terminated) == (0.0, False)
        assert info["outcome"]["reason"] == "nothing lifted"
        assert info["trials_left"] == trials_left
        assert observation["instruction"] == first["instruction"]
    assert truncated
    with pytest.raises(RuntimeError, match="call reset"):
        env.step(action)
    with pytest.raises(RuntimeError, match="call reset"):
        env.oracle()


def test_the_judge_tells_part_object_and_air_apart(env):
    hammer = GOALS.index(Goal("mini-claw-hammer", "handle"))
    env.reset(seed=5, options={"goal": hammer})
    goal = env.goal
    assert goal == GOALS[hammer]
    outcome = env.attempt(oracle_for(env, part_of_other(env, goal)))
    assert (outcome.reason, outcome.part, outcome.lifted) == ("wrong part", "head", ("mini-claw-hammer",))
    assert outcome.correct_object
    assert not outcome.success
    outcome = env.attempt(oracle_for(env, env._goals[1]))
    assert (outcome.reason, outcome.lifted) == ("wrong object", (env._goals[1].object,))
    assert outcome.grasped
    assert not outcome.correct_object
    outcome = env.attempt(WORKSPACE.to_grasp(corner(env)))
    assert (outcome.reason, outcome.part, outcome.lifted) == ("nothing lifted", None, ())
    assert not outcome.grasped
    # all of them are still there to be picked
    outcome = env.attempt(env.oracle()[0])
    assert (outcome.reason, outcome.part) == ("success", "handle")
    assert env.goal == env._goals[1]


@pytest.mark.parametrize(
    ("lifted", "touched", "reason", "part"),
    [
        (["mug"], {"mug": ["brim", "handle"]}, "success", "brim"),
        (["mug"], {"mug": ["handle", "brim"]}, "success", "brim"),
        (["mug"], {"mug": ["handle", "brim", "handle"]}, "wrong part", "handle"),
        (["mug"], {"mug": [None, None, "brim"]}, "wrong part", "brim"),
        (["mug"], {}, "wrong part", None),
        (["mug", "fork"], {"mug": ["brim"], "fork": ["end"]}, "several lifted", "brim"),
        (["fork"], {"fork": ["end"], "mug": ["brim"]}, "wrong object", "end"),
        ([], {"mug": ["brim"]}, "nothing lifted", "brim"),
    ],
)
def test_the_judge_counts_contact_points(lifted, touched, reason, part):
    outcome = judge(Goal("mug", "brim"), lifted, touched)
    assert (outcome.reason, outcome.part) == (reason, part)
    assert outcome.success == (reason == "success")
    assert outcome.grasped == bool(lifted)


def test_any_part_will_do_for_a_goal_without_one():
    assert judge(Goal("mug"), ["mug"], {"mug": ["handle"]}).success
    assert not judge(Goal("mug"), ["mug", "fork"], {"mug": ["handle"]}).success


def test_same_seed_same_bits_in_any_order_and_any_process(env):
    first = fingerprint(env, 11)
    other = fingerprint(env, 12)
    assert first != other
    with GraspEnv(camera="overhead") as fresh:
        assert fingerprint(fresh, 12) == other
        assert fingerprint(fresh, 11) == first
    code = (
        "import sys; sys.path.insert(0, 'tests'); import test_env as t\n"
        "print('bits', t.fingerprint(t.GraspEnv(camera='overhead'), 11))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert f"bits {first}" in out


@pytest.mark.parametrize("camera", ["fused", "overhead"])
def test_what_is_done_to_an_observation_reaches_nobody(camera):
    env = GraspEnv(camera=camera)
    try:
        env.reset(seed=13)
        grasp, quality = env.oracle()
        untouched, outcome = env.observation, env.attempt(grasp)
        env.reset(seed=13)
        seen = env.observation
        seen.color[:] = 255 - seen.color
        for height in (seen.height, env.truth().height):
            height[:] = (height - height.mean()) / height.std()
        assert env.observation.same(untouched)
        assert env.oracle() == (grasp, quality)
        assert env.attempt(grasp) == outcome
        assert outcome.success
    finally:
        env.close()


def test_looking_does_not_change_what_happens(env):
    env.reset(seed=13)
    grasp, _ = env.oracle()
    outcome = env.attempt(grasp)
    after = env.observation
    env.reset(seed=13)
    env.render_mode = "rgb_array"
    for _ in range(2):
        assert env.render().shape == (480, 640, 3)
        assert env.oracle()[0] == grasp
    env.render_mode = None
    assert env.attempt(grasp) == outcome
    assert env.observation.same(after)


@pytest.mark.parametrize("goal", [None, 3])
def test_what_lies_on_the_table_is_drawn_from_all_that_the_task_has(goal: int | None) -> None:
    task = TASKS["pick-by-part"]
    draw = EpisodeDraw(task, "seen", clearance=0.005)
    times, first = Counter(), Counter()
    for seed in range(200):
        episode = draw(np.random.default_rng(seed), {} if goal is None else {"goal": goal})
        names = [asked.name for asked in episode.goals]
        assert [asset.name for asset in episode.assets] == names
        others = names if goal is None else names[1:]
        times.update(others)
        first[others[0]] += 1
    fewest, most = task.objects
    if goal is not None:
        fewest, most = fewest - 1, most - 1
    drawn = [name for name in task.pool if goal is None or name != task.goals[goal].name]
    assert set(times) == set(first) == set(drawn)
    expected = 200 * (fewest + most) / 2 / len(drawn)
    assert all(0.6 * expected < times[name] < 1.4 * expected for name in drawn)
    assert max(first.values()) < 3 * 200 / len(drawn)


def test_the_goal_and_the_phrasing_can_be_asked_for(env):
    for goal in (0, 13, 22):
        observation, info = env.reset(seed=3, options={"goal": goal, "phrasing": 2})
        assert info["goal"] == {
            "name": GOALS[goal].name,
            "object": GOALS[goal].object,
            "color": None,
            "part": GOALS[goal].part,
            "kind": "by part",
            "words": (GOALS[goal].object.replace("-", " "), GOALS[goal].part),
            "index": goal,
        }
        assert observation["instruction"].startswith("grab ")
        assert len({asked.object for asked in env._goals}) == len(env._goals)
    with GraspEnv(camera="overhead", phrasings="unseen") as unseen:
        observation, _ = unseen.reset(seed=3, options={"goal": 13, "phrasing": 0})
        assert observation["instruction"] == "raise the mug with the brim between your fingers"


def test_scenes_keep_their_distance_and_stay_on_the_table(env):
    (x_min, x_max), (y_min, y_max) = WORKSPACE.bounds
    for seed in range(8):
        env.reset(seed=seed)
        outlines = []
        for name in env._scene.bodies:
            pose = env._scene.pose(name)
            outlines.append(pose.position[:2] + env._scene.asset(name).footprint @ pose.rotation[:2, :2].T)
        for i, outline in enumerate(outlines):
            assert outline.min() > min(x_min, y_min)
            assert (np.abs(outline) < [x_max, y_max]).all()
            for other in outlines[:i]:
                gaps = np.linalg.norm(outline[:, None] - other[None], axis=-1)
                assert gaps.min() > CLEARANCE - 0.002


@pytest.mark.parametrize(
    "options", [{"goal": 23}, {"goal": -1}, {"goal": 1.5}, {"goal": True}, {"phrasing": 20}, {"gaol": 1}]
)
def test_wrong_options_are_refused(env, options):
    with pytest.raises(ValueError, match=next(iter(options))):
        env.reset(seed=0, options=options)


@pytest.mark.parametrize(
    "action",
    [
        [320, 0, 0],
        [0, 160, 0],
        [0, 0, 36],
        [-1, 0, 0],
        [0, 0],
        [1.0, 2.0, 3.0],
        [np.nan, 0, 0],
        None,
        "up",
        [[1, 2, 3]],
        Grasp(40.3, 20.0, 0.1),
    ],
)
def test_wrong_actions_are_refused(env, action):
    env.reset(seed=0)
    with pytest.raises(ValueError, match="three whole numbers"):
        env.step(action)
    with pytest.raises(ValueError, match="outside the heightmap"):
        env.attempt(Grasp(400, 20, 0))


def test_a_grasp_in_place_of_an_action_hears_what_takes_it(env):
    env.reset(seed=0)
    grasp, quality = env.oracle()
    assert 0 <= quality <= 1
    with pytest.raises(ValueError, match=r"WORKSPACE\.to_action\(grasp\).* env\.unwrapped\.attempt\(grasp\)"):
        gymnasium.wrappers.TimeLimit(env, 5).step(grasp)
    assert env.step(WORKSPACE.to_action(grasp))[1] > 0
    assert env.attempt(env.oracle()[0]).success


@pytest.mark.parametrize(
    ("name", "value"),
    [("camera", "side"), ("render_mode", "video"), ("phrasings", "heard"), ("task", "pick-nothing")],
)
def test_wrong_arguments_are_refused(name, value):
    wrong: dict[str, Any] = {name: value}
    with pytest.raises(ValueError, match=value):
        GraspEnv(**wrong)


@pytest.mark.parametrize("clearance", [-1, 0, 0.0009, np.nan, np.inf, None, "x", True, [0.01]])
def test_a_clearance_that_is_none_is_refused_at_once(clearance):
    sentence = f"clearance is metres between two objects, a number from 0.001, but this is {clearance!r}"
    with pytest.raises(ValueError, match=re.escape(sentence)):
        GraspEnv(clearance=clearance)
    numbers: list[Any] = [0.001, 0.02, np.float32(0.01)]
    for right in numbers:
        GraspEnv(clearance=right)


def test_nothing_works_before_reset_and_closing_twice_is_fine():
    env = GraspEnv(camera="overhead")
    things: tuple[Callable[[], Any], ...] = (
        lambda: env.step([0, 0, 0]),
        env.oracle,
        lambda: env.observation,
        lambda: env.instruction,
        lambda: env.goal,
    )

    def nothing_works() -> None:
        for ask in things:
            with pytest.raises(RuntimeError, match="call reset"):
                ask()

    nothing_works()
    assert (env.terminated, env.truncated) == (False, False)
    first, _ = env.reset(seed=0)
    assert (env.terminated, env.truncated) == (False, False)
    env.close()
    nothing_works()
    env.close()
    nothing_works()
    again, _ = env.reset(seed=0)
    np.testing.assert_array_equal(again["height"], first["height"])
    env.close()


@pytest.mark.parametrize("camera", ["fused", "overhead"])
def test_gymnasium_finds_nothing_to_complain_about(camera):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make("equigrasp/PickByPart-v0", camera=camera, render_mode="rgb_array")
        check_env(env.unwrapped)
    env.close()
