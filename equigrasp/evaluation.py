"""How a policy is tested: single-shot queries balanced over a task's goals, and the paper's protocol.

Everything here speaks Gymnasium: a policy is any function from an observation and an instruction to a grasp,
so the oracle, a baseline and a user's own model are evaluated by the same lines.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable

from equigrasp.collection import check_seed
from equigrasp.environment import Environment
from equigrasp.errors import InputError
from equigrasp.grasp import Grasp, Observation
from equigrasp.success import Evaluation, Scene, Trial
from equigrasp.workspace import WORKSPACE

FIRST_SEED = 10**9
"""Evaluation scenes have seeds from here on; demonstrations never do."""
VALIDATION_SEED = 3 * 10**9
"""Scenes in which a checkpoint is chosen have seeds from here on; no test has one."""
SCENES_PER_SEED = 10**6

Act = Callable[[Observation, str], Grasp]


def scene_seed(seed: int, index: int, first: int = FIRST_SEED) -> int:
    """What the environment is reset with for the index-th scene of an evaluation with this seed."""
    return first + seed * SCENES_PER_SEED + index


def scene_at(place: int) -> int:
    """What the environment is reset with for a test scene by its place among those of all seeds, 0 the first of seed 0.

    Raises:
        InputError: if there is no such scene.
    """
    last = scene_seed(999, SCENES_PER_SEED - 1) - FIRST_SEED
    if not 0 <= place <= last:
        raise InputError(
            f"--seed is {place}, but it must be from 0 to {last}; the seed that an evaluation's file has of a trial is "
            f"{FIRST_SEED} more"
        )
    return scene_seed(0, place)


def single_shot(
    act: Act,
    env: Environment,
    goals: int,
    queries: int,
    seed: int,
    progress: Callable[[range], Iterable[int]] = iter,
    first: int = FIRST_SEED,
) -> Evaluation:
    """One grasp in each of many fresh scenes, the goals in turn (`goal_of`): no retries, no easy goal counted twice.

    Args:
        act: the policy.
        env: an environment of the task.
        goals: how many goals the task has.
        queries: how many scenes.
        seed: which scenes, from 0 to 999.
        progress: wraps the range of queries, for a progress bar.
        first: `FIRST_SEED`, or `VALIDATION_SEED` for scenes that no test has.

    Raises:
        InputError: if `queries` or `seed` are out of range, the environment is wrapped, or the policy gives no grasp.
    """
    _check_environment(env)
    check_scenes(queries, seed)
    trials = []
    for index in progress(range(queries)):
        start = scene_seed(seed, index, first)
        _, info = env.reset(seed=start, options={"goal": goal_of(index, queries, goals)})
        trial, *_ = _try(act, env, start, 0, info)
        trials.append(trial)
    return Evaluation(tuple(trials))


def goal_of(index: int, queries: int, goals: int) -> int:
    """Which goal a query asks for: one after the other, or, of fewer queries than goals, evenly spread over them.

    Goals of one kind stand together: the first hundred of 175 would be all fruit and hardly anything else.

    Args:
        index: of the query, from 0.
        queries: how many there are.
        goals: how many goals the task has.
    """
    return index % goals if queries >= goals else index * goals // queries


def episodes(
    act: Act,
    env: Environment,
    scenes: int,
    seed: int,
    progress: Callable[[range], Iterable[int]] = iter,
    first: int = FIRST_SEED,
) -> Evaluation:
    """The paper's protocol: in each scene n goals one after the other, n + 1 trials, reward 1 / n each.

    Args:
        act: the policy.
        env: an environment of the task.
        scenes: how many scenes.
        seed: which scenes, from 0 to 999.
        progress: wraps the range of scenes, for a progress bar.
        first: as for `single_shot`.

    Raises:
        InputError: as for `single_shot`.
    """
    _check_environment(env)
    check_scenes(scenes, seed)
    trials, results = [], []
    for index in progress(range(scenes)):
        start = scene_seed(seed, index, first)
        _, info = env.reset(seed=start)
        goals, reached, count, over = int(info["trials_left"]) - 1, 0, 0, False
        while not over:
            trial, info, over = _try(act, env, start, count, info)
            trials.append(trial)
            reached += trial.correct
            count += 1
        results.append(Scene(start, goals, reached))
    return Evaluation(tuple(trials), tuple(results))


def check_scenes(count: int, seed: int) -> None:
    """Raise an InputError unless a seed has so many scenes, at least one, and there is such a seed."""
    if not 1 <= count <= SCENES_PER_SEED:
        raise InputError(f"--scenes is {count}, but it must be from 1 to {SCENES_PER_SEED}")
    check_seed(seed)


def _check_environment(env: Environment) -> None:
    """Raise an InputError for a wrapper that hides what a policy is shown, as `gymnasium.make` puts around."""
    # static: before a reset the properties raise
    hidden = [name for name in ("observation", "instruction") if inspect.getattr_static(env, name, None) is None]
    if hidden and getattr(env, "unwrapped", env) is not env:
        raise InputError(
            f"{env} hides the environment's {' and '.join(hidden)}; pass env.unwrapped, as what `gymnasium.make` gives "
            "is wrapped, or a wrapper of your own that has both"
        )


def _try(act: Act, env: Environment, seed: int, trial: int, info: dict) -> tuple[Trial, dict, bool]:
    goal, instruction = info["goal"], env.instruction
    grasp = act(env.observation, instruction)
    if not isinstance(grasp, Grasp):
        raise InputError(
            f"the policy gave {grasp!r:.100} for {instruction!r}, but a policy gives an `equigrasp.grasp.Grasp` (u, v, "
            "theta); of an action (u, v, bin), `WORKSPACE.to_grasp` makes one"
        )
    _, reward, terminated, truncated, after = env.step(WORKSPACE.to_action(grasp))
    outcome = after["outcome"]
    record = Trial(
        seed=seed,
        trial=trial,
        goal=goal["index"],
        object=goal["name"],
        part=goal["part"],
        instruction=instruction,
        grasp=(grasp.u, grasp.v, grasp.theta),
        grasped=bool(outcome["lifted"]),
        correct_object=bool(outcome["correct_object"]),
        correct=float(reward) > 0,
        reason=str(outcome["reason"]),
        lifted=tuple(outcome["lifted"]),
        held=outcome.get("part"),
    )
    return record, after, terminated or truncated
