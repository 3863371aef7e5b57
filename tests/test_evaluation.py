"""Rates count what the judge says; the oracle passes through the same lines as any policy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from equigrasp.errors import InputError
from equigrasp.evaluation import episodes, goal_of, single_shot
from equigrasp.grasp import Grasp, Observation
from equigrasp.success import Evaluation, MeanReward, Rate, Scene, Trial, wilson
from tasks import TASKS
from tasks.env import GraspEnv
from tasks.oracle import best_grasps, see

CORNER = Grasp(1, 1, 0.0)


def nowhere(observation: Observation, instruction: str) -> Grasp:
    """A policy that always grasps the table's corner."""
    return CORNER


@given(st.integers(1, 1000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_an_interval_holds_its_rate(counts: tuple[int, int]) -> None:
    rate = Rate(*counts)
    low, high = rate.interval
    assert 0 <= low <= rate.value <= high <= 1
    wider = Rate(counts[0], counts[1]).interval
    narrower = Rate(4 * counts[0], 4 * counts[1]).interval
    assert narrower[1] - narrower[0] <= wider[1] - wider[0] + 1e-12


def test_the_interval_is_wilsons() -> None:
    """Newcombe 1998, table I: 81 of 263 gives 0.2553 to 0.3662."""
    assert Rate(81, 263).interval == pytest.approx((0.2553, 0.3662), abs=5e-5)


@given(counts=st.integers(1, 10**6).flatmap(lambda trials: st.tuples(st.integers(0, trials), st.just(trials))))
def test_of_a_share_the_interval_is_scipys(counts: tuple[int, int]) -> None:
    expected = binomtest(*counts).proportion_ci(0.95, method="wilson")
    assert Rate(*counts).interval == pytest.approx((expected.low, expected.high), rel=1e-9, abs=1e-12)


def covered(interval: Callable[[float, int], tuple[float, float]], shares: Sequence[float], scenes: int) -> float:
    """How often the interval has the true mean, where a scene's goals are reached or not by these chances at once.

    Args:
        interval: of a mean and a count of scenes.
        shares: a scene is one of them by chance: of its 4 goals each is reached by that share.
        scenes: in one evaluation, of 4,000.
    """
    generator = np.random.default_rng(0)
    each = generator.choice(np.array(shares), size=(4000, scenes))
    means = (generator.binomial(4, each) / 4).mean(axis=1)
    bounds = np.array([interval(float(mean), scenes) for mean in means])
    truth = float(np.mean(shares))
    return float(np.mean((bounds[:, 0] <= truth) & (truth <= bounds[:, 1])))


@pytest.mark.parametrize("scenes", [10, 100])
@pytest.mark.parametrize("shares", [[0.97], [0.5], [0.0, 1.0], [0.0, 1.0, 1.0, 1.0], [0.2, 0.9]], ids=str)
def test_the_interval_of_a_mean_reward_has_the_true_one_in_94_of_100(shares: list[float], scenes: int) -> None:
    """Whether a scene's goals are reached together or each by itself."""
    assert covered(wilson, shares, scenes) >= 0.94


def test_one_that_counts_goals_and_not_scenes_has_not() -> None:
    assert covered(lambda mean, scenes: wilson(mean, 4 * scenes), [0.0, 1.0], 100) < 0.8


def test_of_trials_that_share_scenes_the_interval_is_that_of_scenes() -> None:
    shared, own = Rate(40, 400, scenes=100), Rate(40, 400)
    assert shared.value == own.value
    assert shared.interval == wilson(0.1, 100)
    assert shared.interval[1] - shared.interval[0] > 1.5 * (own.interval[1] - own.interval[0])
    assert str(shared).endswith("(40 of 400 in 100 scenes)")


def shares(goal_for: Callable[[int, int, int], int], queries: int, goals: int) -> float:
    """By how many queries a run of goals that stand together has more or less than its share, at the most."""
    counts = np.bincount([goal_for(index, queries, goals) for index in range(queries)], minlength=goals)
    assert len(counts) == goals
    so_far = np.concatenate([[0.0], np.cumsum(counts - queries / goals)])
    return float(so_far.max() - so_far.min())


@given(queries=st.integers(1, 300), goals=st.integers(1, 300))
def test_goals_of_a_kind_have_their_share_of_the_queries(queries: int, goals: int) -> None:
    if queries <= goals:
        assert shares(goal_of, queries, goals) < 1 + 1e-9
    # what is more than a whole round goes to the first goals, one each
    assert np.ptp(np.bincount([goal_of(index, queries, goals) for index in range(queries)], minlength=goals)) <= 1


def test_the_first_goals_have_not() -> None:
    assert shares(lambda index, queries, goals: index % goals, 100, 175) > 40


def test_few_queries_of_many_goals_ask_for_all_kinds() -> None:
    task = TASKS["pick-random-v2"]
    asked = {task.goals[goal_of(index, 100, len(task.goals))].object for index in range(100)}
    assert asked == {goal.object for goal in task.goals}


def test_of_no_scene_there_is_no_interval() -> None:
    assert all(math.isnan(bound) for bound in MeanReward(math.nan, 0).interval)


def test_the_oracle_reaches_goals_and_the_corner_none(env: GraspEnv) -> None:
    oracle = single_shot(lambda observation, instruction: env.oracle()[0], env, 23, 12, seed=5)
    corner = single_shot(nowhere, env, 23, 3, seed=5)
    assert oracle.correct.successes >= 11
    assert corner.grasped.successes == 0
    assert [trial.goal for trial in oracle.trials] == [goal_of(index, 12, 23) for index in range(12)]
    assert [trial.reason for trial in corner.trials] == ["nothing lifted"] * 3
    assert corner.recorded()["failures"] == {"nothing lifted": 3}
    assert {**oracle.rates(), "failures": oracle.failures, "mistaken": oracle.mistaken} == oracle.recorded()
    assert corner.mistaken == {}
    assert sum(oracle.failures.values()) == 12 - oracle.correct.successes


def test_what_is_mistaken_for_what_is_named(env: GraspEnv) -> None:
    """A policy that always takes the fork by its head mistakes everything else for that, parts and all."""
    head = next(goal for goal in env.task.goals if str(goal) == "fork by head")

    def stubborn(observation: Observation, instruction: str) -> Grasp:
        _, scene = env.started()
        if "fork" not in scene.bodies:
            return CORNER
        return best_grasps(see(scene, head, *env._overhead_view()), 1)[0][0]

    result = single_shot(stubborn, env, 23, 46, seed=0)
    taken = [trial.taken for trial in result.trials]
    assert len(set(taken) - {None}) <= 3, "the fork by one part or, by an unlucky neighbour, another"
    named = {asked: sum(others.values()) for asked, others in result.mistaken.items()}
    assert "fork by head" not in named
    assert "fork by end" in named
    assert len(named) > 2
    others = sum(count for kind, count in result.failures.items() if kind != "nothing lifted")
    assert sum(named.values()) == others > 3
    assert all(name.startswith("fork by ") for others in result.mistaken.values() for name in others)
    assert result.lines()[-1].startswith("most often taken      fork by head for ")


def test_the_papers_protocol(env: GraspEnv) -> None:
    """n goals, n + 1 trials: failing always uses them up, the oracle's reward is the share of goals reached."""
    corner = episodes(nowhere, env, 1, seed=0)
    scene = corner.scenes[0]
    assert len(corner.trials) == scene.goals + 1
    assert corner.reward == MeanReward(0, len(corner.scenes))
    oracle = episodes(lambda observation, instruction: env.oracle()[0], env, 2, seed=0)
    mean = sum(scene.reached / scene.goals for scene in oracle.scenes) / len(oracle.scenes)
    assert oracle.reward.value == pytest.approx(mean)
    assert oracle.reward.scenes == len(oracle.scenes)
    assert oracle.reached.value > 0.8


def test_the_same_seed_gives_the_same_trials(env: GraspEnv) -> None:
    first, second = (
        single_shot(lambda observation, instruction: env.oracle()[0], env, 23, 3, seed=2) for _ in range(2)
    )
    assert first.to_dict() == second.to_dict()


def test_no_scenes_is_refused(env: GraspEnv) -> None:
    with pytest.raises(InputError, match="--scenes is 0"):
        single_shot(nowhere, env, 23, 0, seed=0)
    with pytest.raises(InputError, match="--seed is 1000"):
        episodes(nowhere, env, 1, seed=1000)


def test_a_wrapped_environment_is_refused_in_one_sentence() -> None:
    wrapped = gymnasium.make("equigrasp/PickByPart-v0", camera="overhead")
    for evaluate in (
        lambda env: single_shot(nowhere, env, 23, 1, seed=0),
        lambda env: episodes(nowhere, env, 1, seed=0),
    ):
        with pytest.raises(
            InputError, match=r"hides the environment's observation and instruction; pass env\.unwrapped"
        ):
            evaluate(wrapped)
    inner = wrapped.unwrapped
    assert isinstance(inner, GraspEnv)
    assert single_shot(nowhere, inner, 23, 1, seed=0).correct.trials == 1
    wrapped.close()


def test_a_wrapper_that_shows_both_is_taken(env: GraspEnv) -> None:
    class Dark(gymnasium.Wrapper):
        """What a user may want to try: the same scenes, nothing seen."""

        @property
        def observation(self) -> Observation:
            seen = env.observation
            return replace(seen, color=np.zeros_like(seen.color))

        @property
        def instruction(self) -> str:
            return env.instruction

    def look(observation: Observation, instruction: str) -> Grasp:
        assert not observation.color.any()
        return CORNER

    assert single_shot(look, Dark(env), 23, 1, seed=0).correct.trials == 1


def test_a_policy_that_gives_no_grasp_is_refused_in_one_sentence(env: GraspEnv) -> None:
    with pytest.raises(InputError, match=r"the policy gave \(1, 1, 0\).*`WORKSPACE\.to_grasp`"):
        single_shot(lambda observation, instruction: (1, 1, 0), env, 23, 1, seed=0)  # ty: ignore[invalid-argument-type]


MUG = Trial(10**9, 0, 3, "mug", "handle", "", (0.0, 0.0, 0.0), False, False, False, "nothing lifted", (), None)
"""A grasp at nothing."""
WRONG = replace(MUG, grasped=True, reason="wrong object", lifted=("fork",), held="head")
PART = replace(WRONG, correct_object=True, reason="wrong part", lifted=("mug",), held="rim")
RIGHT = replace(PART, correct=True, reason="success", held="handle")
MOSTLY = replace(RIGHT, held="rim")
"""Right by half of the contacts, though another part has as many."""


BARELY = replace(PART, held="handle")
"""Wrong by less than half of the contacts, though no other part has as many: nothing was taken for something else."""


def test_each_rate_counts_its_own() -> None:
    trials = (MUG, WRONG, WRONG, PART, RIGHT, MOSTLY, BARELY)
    scenes = (Scene(1, goals=4, reached=1), Scene(2, goals=5, reached=5))
    evaluation = Evaluation(trials, scenes)
    assert evaluation.grasped == Rate(6, 7, scenes=2)
    assert evaluation.correct_object == Rate(4, 7, scenes=2)
    assert evaluation.correct == Rate(2, 7, scenes=2)
    assert evaluation.reached == Rate(6, 9, scenes=2)
    assert Evaluation(trials).correct == Rate(2, 7)
    assert evaluation.reward == MeanReward((1 / 4 + 5 / 5) / 2, 2)
    assert evaluation.failures == {"nothing lifted": 1, "wrong object": 2, "wrong part": 2}
    assert evaluation.mistaken == {"mug by handle": {"fork by head": 2, "mug by rim": 1}}
    recorded = evaluation.recorded()
    assert {name: recorded[name]["successes"] for name in ("grasped", "correct_object", "correct", "reached")} == {
        "grasped": 6,
        "correct_object": 4,
        "correct": 2,
        "reached": 6,
    }
    assert (recorded["reward"], recorded["scenes"]) == (evaluation.reward.value, 2)
    assert recorded["reward_interval"] == list(evaluation.reward.interval)


def test_what_the_judge_says_is_what_is_counted(env: GraspEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each trial has the environment's own words: nothing is inferred from another."""
    said = [
        (0.0, {"lifted": [], "correct_object": False, "reason": "nothing lifted", "part": None}),
        (0.0, {"lifted": ["fork"], "correct_object": False, "reason": "wrong object", "part": "head"}),
        (0.0, {"lifted": ["mug"], "correct_object": True, "reason": "wrong part", "part": "rim"}),
        (0.25, {"lifted": ["mug"], "correct_object": True, "reason": "success", "part": "handle"}),
    ]
    judged = iter(said)

    def step(action: object) -> tuple[None, float, bool, bool, dict[str, object]]:
        reward, outcome = next(judged)
        return None, reward, True, False, {"outcome": outcome}

    monkeypatch.setattr(env, "step", step)
    trials = single_shot(nowhere, env, 23, 4, seed=0).trials
    assert [(each.grasped, each.correct_object, each.correct) for each in trials] == [
        (False, False, False),
        (True, False, False),
        (True, True, False),
        (True, True, True),
    ]
    assert [each.reason for each in trials] == [outcome["reason"] for _, outcome in said]
    assert [each.held for each in trials] == [None, "head", "rim", "handle"]


def test_an_empty_evaluation_has_no_rate() -> None:
    assert str(Evaluation(()).correct).startswith("nan")
