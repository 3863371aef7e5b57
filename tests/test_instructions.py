import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tasks import TASKS, find_task
from tasks.combinations import FRUIT, HELD_OUT, TOOLS, TOYS, combinations, held_out
from tasks.goal import Goal
from tasks.instructions import CHARSET, GRAMMARS, LONGEST, Grammar, render
from tasks.objects import PAINTS
from tasks.task import Task, each_of

GOALS = {kind: [goal for task in TASKS.values() for goal in task.goals if goal.kind == kind] for kind in GRAMMARS}
"""Every goal of the suite by its kind."""


def sentences(goal: Goal) -> list[str]:
    grammar = GRAMMARS[goal.kind]
    return [render(goal, phrasing) for phrasing in grammar.seen + grammar.held_out]


def test_the_13_tasks_have_the_papers_goals():
    counts = {name: len(task.goals) for name, task in TASKS.items()}
    assert counts == {
        "pick-colored-ell": 10,
        "pick-fruit": 6,
        "pick-tool": 8,
        "pick-toy": 8,
        "pick-caption": 8,
        "pick-logo": 6,
        "pick-random-v1": 46,
        "pick-colored-fruit": 60 - 13,
        "pick-colored-tool": 80 - 16,
        "pick-colored-toy": 80 - 16,
        "pick-random-v2": 175,
        "pick-novel-v2": 45,
        "pick-by-part": 23,
    }
    for task in TASKS.values():
        assert len(set(task.goals)) == len(task.goals)
    assert len({task.env_id for task in TASKS.values()}) == 13


def test_no_held_out_combination_is_in_any_task_that_trains():
    novel = {goal.name for goal in held_out()}
    assert len(novel) == 45
    for task in TASKS.values():
        assert not task.trains or novel.isdisjoint(task.pool)
    assert {goal.name for goal in combinations((*FRUIT, *TOOLS, *TOYS))} | novel == {
        f"{color} {shape}" for shape in (*FRUIT, *TOOLS, *TOYS) for color in PAINTS
    }
    with pytest.raises(ValueError, match="held out of all training data"):
        TASKS["pick-novel-v2"].demonstration_goals(np.random.default_rng(0))


def test_every_shape_and_every_colour_is_held_out_about_equally_often():
    assert set(map(len, HELD_OUT.values())) == {2, 3}
    assert set(Counter(goal.color for goal in held_out()).values()) == {4, 5}
    assert len(set(HELD_OUT.values())) == len(HELD_OUT)


@pytest.mark.parametrize(
    ("name", "grasps"), [("pick-random-v1", 47), ("pick-random-v2", 22), ("pick-by-part", 23), ("pick-fruit", 6)]
)
def test_a_demonstration_has_as_many_grasps_as_the_papers(name: str, grasps: int):
    task = TASKS[name]
    for seed in range(20):
        goals = task.demonstration_goals(np.random.default_rng(seed))
        assert goals == task.demonstration_goals(np.random.default_rng(seed))
        assert len(goals) == grasps
        assert {task.goals[index].object for index in goals} == {goal.object for goal in task.goals}


def test_a_demonstration_of_each_object_spreads_over_the_colours():
    task = TASKS["pick-random-v2"]
    for seed in range(20):
        goals = [task.goals[index] for index in task.demonstration_goals(np.random.default_rng(seed))]
        colors = Counter(goal.color for goal in goals)
        assert set(colors) == set(PAINTS)
        assert max(colors.values()) <= 4


def test_demonstrations_show_every_goal_sooner_or_later():
    """No object comes in one colour again and again, and none is always the first to choose."""
    task = TASKS["pick-random-v2"]
    shown = {index for seed in range(100) for index in task.demonstration_goals(np.random.default_rng(seed))}
    assert shown == set(range(len(task.goals)))


@pytest.mark.parametrize("kind", GRAMMARS)
def test_there_are_20_phrasings_and_at_least_8_held_out(kind: str):
    assert len(set(GRAMMARS[kind].seen)) == 20
    assert len(set(GRAMMARS[kind].held_out)) >= 8


def test_no_sentence_says_two_things_and_none_is_both_seen_and_unseen():
    goals = {goal for task in TASKS.values() for goal in task.goals}
    said = [sentence for goal in goals for sentence in sentences(goal)]
    assert len(set(said)) == len(said)


@pytest.mark.parametrize("kind", GRAMMARS)
def test_unseen_phrasings_use_no_verb_of_the_seen_ones(kind: str):
    for verb in GRAMMARS[kind].verbs:
        assert not any(re.search(rf"\b{verb}\b", phrasing) for phrasing in GRAMMARS[kind].held_out), verb


@pytest.mark.parametrize("kind", GRAMMARS)
def test_every_sentence_says_each_word_of_its_goal_once_in_plain_english(kind: str):
    assert GOALS[kind]
    for goal in GOALS[kind]:
        words = GRAMMARS[kind].words(goal)
        assert all(words)
        for sentence in sentences(goal):
            for word in words:
                assert len(re.findall(rf"\b{word}\b", sentence)) == 1, sentence
            assert "-" not in sentence
            assert "{" not in sentence
            assert "  " not in sentence
            assert set(sentence) <= set(CHARSET)
            assert len(sentence) <= LONGEST


def test_scissors_are_several():
    by_part = GRAMMARS["by part"]
    assert render(Goal("scissors", "handle"), by_part.seen[0]) == "pick up the scissors by their handle"
    assert render(Goal("mug", "handle"), by_part.seen[0]) == "pick up the mug by its handle"
    assert not any("scissors's" in render(Goal("scissors", "handle"), phrasing) for phrasing in by_part.held_out)
    blue = [render(Goal("scissors", color="blue"), phrasing) for phrasing in GRAMMARS["colored object"].seen]
    assert "grasp the scissors that are blue" in blue


def test_what_is_said_of_marks_and_colours():
    assert "grab bottle K" in sentences(Goal("bottle-K", kind="caption"))
    assert "lift the block with the moon logo" in sentences(Goal("block-moon", kind="logo"))
    assert "please pick up the pink medium clamp" in sentences(Goal("medium-clamp", color="pink"))
    assert Goal("medium-clamp", color="pink").name == "pink medium-clamp"


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(ValueError, match="pick-by-part"):
        find_task("pick-by-prat")
    with pytest.raises(ValueError, match="seen"):
        GRAMMARS["by part"].phrasings("heard")  # ty: ignore[invalid-argument-type]
    with pytest.raises(ValueError, match="by part"):
        Task("pick-smell", "equigrasp/PickSmell-v0", each_of(["mug"], kind="by smell"), objects=(1, 1))


def test_a_task_needs_enough_objects_to_fill_a_scene():
    with pytest.raises(ValueError, match="name 1"):
        Task("pick-one", "equigrasp/PickOne-v0", (Goal("mug"),))


def row(*goals: Goal, **settings) -> Task:
    return Task("mine", "equigrasp/Mine-v0", goals, objects=(1, 1), **settings)


@pytest.mark.parametrize(
    ("task", "sentence"),
    [
        (row(Goal("mug", "spout")), "by its 'spout', but its parts are brim, handle"),
        (row(Goal("mugg")), "there is no object 'mugg'; did you mean 'mug'"),
        (row(Goal("mug", color="bleu")), "there is no colour 'bleu'; did you mean 'blue'"),
        (row(Goal("mug", kind="x"), grammars={"x": Grammar(("{verb} the {objekt}",), ("x",))}), "has a slot 'objekt'"),
        (
            row(Goal("mug", kind="x"), grammars={"x": Grammar(("{verb} " + 99 * "very ",), ("x",))}),
            "1 to 128 characters",
        ),
        (
            row(Goal("mug", kind="x"), grammars={"x": Grammar(("{verb} the {object}\u00e9",), ("x",))}),
            "1 to 128 characters",
        ),
    ],
)
def test_a_row_that_cannot_be_is_one_sentence(task: Task, sentence: str):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        task.check()


def test_a_task_of_ones_own_is_found_by_its_name_in_python(monkeypatch, tmp_path):
    (tmp_path / "my_tasks.py").write_text(
        "from tasks import Goal, Task\n"
        "PICK = Task('pick-mine', 'mine/Pick-v0', (Goal('mug', 'handle'), Goal('fork')), objects=(2, 2))\n"
        "OTHER = 1\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert find_task("my_tasks:PICK").pool == ("mug", "fork")
    for name, sentence in {
        "my_tasks:OTHER": "is a int, but it must be a",
        "my_tasks:PICKS": "did you mean 'PICK'",
        "my_task:PICK": "cannot be imported",
        "my_tasks:": "is given as my_package.my_module:MY_TASK",
    }.items():
        with pytest.raises(ValueError, match=sentence):
            find_task(name)


def test_rows_are_data_that_one_can_change():
    easier = replace(TASKS["pick-by-part"], name="pick-two", objects=(2, 2))
    assert easier.goals == TASKS["pick-by-part"].goals
