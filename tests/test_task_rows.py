"""Rows of tasks as a user may write them: each is one clear sentence, or a task that can be played."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from equigrasp.workspace import WORKSPACE
from tasks.env import GraspEnv
from tasks.goal import Goal
from tasks.instructions import Grammar
from tasks.objects import OBJECTS, PAINTS
from tasks.task import Task

ROWS = int(os.environ.get("EQUIGRASP_FUZZ_ROWS", "120"))
"""How many rows are tried."""


def one_of(rng: np.random.Generator, likely: list[Any], odd: list[Any], chance: float = 0.04) -> Any:
    choices = odd if rng.random() < chance else likely
    return choices[int(rng.integers(len(choices)))]


def any_row(rng: np.random.Generator) -> Any:
    """Arguments of a Task, most of them as they should be."""
    names = [*OBJECTS]
    goals = tuple(
        Goal(
            one_of(rng, names, ["", "mugg", "\0", "Mug", "x" * 300]),
            part=one_of(rng, [None, None, None, "body"], ["", "spout", "{part}"]),
            color=one_of(rng, [None, None, *PAINTS], ["", "bleu", "RED"]),
            kind=one_of(rng, [""], ["mine", "caption", "nothing", "colored object"], 0.2),
        )
        for _ in range(int(rng.integers(0, 7)))
    )
    frames = one_of(
        rng, [("{verb} the {object}",), ("take {it}", "{verb} {object}")], [("{nothing}",), ("{",), ("",), ("{0}",), ()]
    )
    return {
        "name": "mine",
        "env_id": "mine/Mine-v0",
        "goals": goals,
        "objects": one_of(rng, [(1, 1), (1, 2), (2, 2)], [(0, 1), (3, 2), (9, 99), (-1, 4)], 0.1),
        "demonstrated": one_of(rng, ["goal", "object"], ["scene"]),
        "repeated": one_of(rng, [0, 1], [-1]),
        "grammars": {"mine": Grammar(frames, held_out=("bring me the {object}",))},
    }


def test_any_row_is_a_clear_sentence_or_a_task_that_can_be_played() -> None:
    rng = np.random.default_rng(0)
    played, refused = 0, set()
    for _ in range(ROWS):
        row = any_row(rng)
        try:
            task = Task(**row)
            task.check()
        except ValueError as error:
            sentence = str(error)
            assert 20 < len(sentence) < 900
            assert "\n" not in sentence
            refused.add(sentence.split("'")[0])
            continue
        goals = task.demonstration_goals(rng)
        assert {task.goals[index].object for index in goals} == {goal.object for goal in task.goals}
        if played < 12:
            env = GraspEnv(task, camera="overhead")
            try:
                env.reset(seed=0)
                outcome = env.step(WORKSPACE.to_action(env.oracle()[0]))[4]["outcome"]
                assert outcome["reason"]
            finally:
                env.close()
        played += 1
    assert played > ROWS / 20
    assert len(refused) > 3
