"""Rows of tasks as a user may write them: each is one clear sentence, or a task that can be played."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from equigrasp.errors import InputError
from equigrasp.workspace import WORKSPACE
from tasks import TASKS
from tasks.arrangement import arrange
from tasks.env import GraspEnv
from tasks.goal import Goal
from tasks.instructions import GRAMMARS, Grammar
from tasks.objects import OBJECTS, PAINTS, ObjectAsset, load
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


@dataclass(frozen=True)
class Borrowed:
    """One of the suite's objects as an object of one's own; what it loads has the suite's name."""

    name: str
    of: str

    def load(self) -> ObjectAsset:
        return load(self.of)


def row(*goals: Goal, **settings: Any) -> Task:
    return Task("mine", "mine/Mine-v0", goals, objects=(1, 1), **settings)


def test_every_row_of_the_suite_passes_its_own_check() -> None:
    for task in TASKS.values():
        task.check()


def spoken(frame: str, *names: str) -> dict[str, Grammar]:
    return {"mine": Grammar(("{verb} the {object}",), (frame,), names or ("object",))}


@pytest.mark.parametrize(
    ("goal", "grammars", "sentence"),
    [
        (
            Goal("banana", kind="by part"),
            {},
            "says a goal's part, but the goal 'banana' has none; give it one",
        ),
        (Goal("banana", kind="colored object"), {}, "says a goal's color, but the goal 'banana' has none"),
        (Goal("banana", kind="caption"), {}, "says a goal's mark (what follows the first hyphen"),
        (Goal("mug", kind="mine"), spoken("hold it by {its} {part}"), "'hold it by {its} {part}' says a goal's part"),
        (Goal("mug", kind="mine"), spoken("{object}", "object", "color"), "the grammar 'mine' says a goal's color"),
        (Goal("mug", kind="mine"), spoken("{object}", "shape"), "the grammar 'mine' has a slot 'shape' that no goal"),
        (Goal("mug", kind="mine"), spoken("{object[size]}"), "is no sentence with slots like {object}"),
    ],
)
def test_what_a_goal_does_not_say_cannot_be_said_of_it(goal: Goal, grammars: dict[str, Grammar], sentence: str) -> None:
    with pytest.raises(InputError, match=re.escape(sentence)):
        row(goal, grammars=grammars).check()


def test_no_goal_and_no_name_of_ones_own_is_there_twice() -> None:
    with pytest.raises(ValueError, match="'mine' has the goal 'mug by brim' 2 times; list it once"):
        row(Goal("mug", "brim"), Goal("fork"), Goal("mug", "brim"))
    twice = (Borrowed("cup", "mug"), Borrowed("cup", "bowl"))
    with pytest.raises(ValueError, match="'mine' has 2 objects of its own called 'cup'; rename all but one"):
        row(Goal("cup"), own=twice)
    # by another part, or in other words, is another goal
    row(Goal("mug", "brim"), Goal("mug", "handle"), Goal("mug")).check()


CUP = Borrowed("cup", "mug")


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"goals": Goal("mug")}, "must be a tuple of goals, but this is Goal(object='mug'"),
        ({"goals": Goal("mug")}, "one alone needs a comma, as in goals=(Goal('mug'),)"),
        ({"goals": "mug"}, "must be a tuple of goals, but this is 'mug'; one"),
        ({"goals": (Goal(name) for name in ("mug", "fork"))}, "must be a tuple of goals, but this is <generator"),
        ({"goals": ("mug",)}, "'mine' has 'mug' among its goals, which is a str; a goal is written Goal('mug')"),
        ({"own": CUP}, "must be a tuple of objects, but this is Borrowed(name='cup', of='mug'); one alone"),
        ({"own": {"cup": CUP}}, "and a dict of objects is own=tuple(objects.values())"),
        ({"own": ("cup",)}, "'mine' has 'cup' among its own objects, which is a str; an object of your own has a name"),
        ({"own": (CUP, Borrowed("lost", "bowl"))}, "'mine' has 'lost' among its own objects, but a scene holds only"),
        ({"own": (CUP, Borrowed("lost", "bowl"))}, "add Goal('lost'), or leave it out of own"),
        ({"objects": 3}, "is two whole numbers, the fewest and the most, as objects=(4, 5), but this is 3"),
        (
            {"objects": (2, 3, 4)},
            "the fewest and the most, as objects=(4, 5), but this is (2, 3, 4)",
        ),
        ({"objects": (1.0, 1)}, "the fewest and the most, as objects=(4, 5), but this is (1.0, 1)"),
        ({"objects": "11"}, "the fewest and the most, as objects=(4, 5), but this is '11'"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)
def test_a_comma_a_kind_or_a_goal_that_is_missing_is_one_sentence(settings: dict[str, Any], sentence: str) -> None:
    arguments: dict[str, Any] = {"goals": (Goal("cup"),), "objects": (1, 1)} | settings
    with pytest.raises(InputError, match=re.escape(sentence)) as error:
        Task("mine", "mine/Mine-v0", **arguments)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("field", "value", "example"),
    [
        ("object", None, "mug"),
        ("object", ("mug",), "mug"),
        ("part", ("handle",), "handle"),
        ("color", (255, 0, 0), "red"),
        ("color", 7, "red"),
        ("kind", True, "by part"),
    ],
)
def test_what_a_goal_is_made_of_is_words(field: str, value: Any, example: str) -> None:
    fields: dict[str, Any] = {"object": "avocado", field: value}
    with pytest.raises(InputError, match=re.escape(f"a goal's {field} is a name such as {example!r}, but this is")):
        Goal(**fields)


def test_what_does_not_fit_on_the_table_is_one_sentence() -> None:
    sentence = "no room was found on the table for 3 objects with 600 mm between them (mug, fork, lion); let the task's"
    with pytest.raises(InputError, match=re.escape(sentence)) as error:
        arrange([load(name) for name in ("mug", "fork", "lion")], np.random.default_rng(0), clearance=0.6, tries=1)
    assert "\n" not in str(error.value)


def test_goals_objects_and_counts_may_stand_in_a_list() -> None:
    goals: Any = [Goal("cup"), Goal("fork")]
    own: Any = {"cup": CUP}.values()
    counts: Any = [np.int64(1), 2]
    task = Task("mine", "mine/Mine-v0", goals, objects=counts, own=own)
    task.check()
    assert task.fingerprint() == Task("mine", "mine/Mine-v0", tuple(goals), objects=(1, 2), own=(CUP,)).fingerprint()


def test_an_object_of_ones_own_has_the_name_that_goals_call_it_by() -> None:
    task = row(Goal("cup", color="blue"), Goal("cup", color="red"), own=(Borrowed("cup", "mug"),))
    for goal in task.goals:
        asset = task.load(goal)
        assert asset.name == goal.name
        assert asset.visual == load("mug").visual
        # what is known of an asset is kept by the asset itself
        assert task.load(goal) is asset
    with GraspEnv(task, camera="overhead") as env:
        for index, goal in enumerate(task.goals):
            info = env.reset(seed=0, options={"goal": index})[1]
            assert info["goal"]["index"] == index
            assert [thing["name"] for thing in info["objects"]] == [goal.name]
            assert env.step(WORKSPACE.to_action(env.oracle()[0]))[4]["outcome"]["reason"] == "success"


PAINTED_PART = Grammar(("{verb} the {color} {object} by {its} {part}",), ("take the {part} of the {color} {object}",))
IN_OTHER_WORDS = Grammar(("{verb} the {object}",), ("fetch it with care",))


@pytest.mark.parametrize(
    ("goals", "settings", "sentence"),
    [
        (
            (Goal("red-mug"), Goal("mug", color="red")),
            {"own": (Borrowed("red-mug", "mug"),), "grammars": {"colored object": GRAMMARS["object"]}},
            None,
        ),
        (
            (Goal("red-mug"), Goal("mug", color="red")),
            {"own": (Borrowed("red-mug", "mug"),)},
            "says 'pick up the red mug' for the goals 'red-mug' and 'red mug'",
        ),
        (
            (Goal("mug", "brim", kind="object"), Goal("mug", "handle", kind="object")),
            {},
            "says 'pick up the mug' for the goals 'mug by brim' and 'mug by handle'",
        ),
        (
            (Goal("mug", kind="mine"), Goal("fork", kind="mine")),
            {"grammars": {"mine": IN_OTHER_WORDS}},
            "says 'fetch it with care' for the goals 'mug' and 'fork'",
        ),
        ((Goal("mug"), Goal("mug", kind="mine")), {"grammars": {"mine": IN_OTHER_WORDS}}, None),
        (
            (Goal("fork"), Goal("banana", color="blue"), Goal("banana")),
            {},
            "says 'pick up the banana' for the goal 'banana', which fits its 'blue banana' as well; leave one out",
        ),
        (
            (Goal("mug", "handle", color="blue"), Goal("mug", "brim", color="red")),
            {},
            "says 'pick up the mug by its handle' for the goal 'blue mug by handle', which fits its 'red mug' as well",
        ),
        (
            (Goal("mug", "handle", color="blue"), Goal("mug", "handle", color="red")),
            {"grammars": {"by part": PAINTED_PART}},
            None,
        ),
        (
            (Goal("mug", color="blue"), Goal("mug", color="red")),
            {"grammars": {"colored object": Grammar(("{verb} the {color} {object}",), ("bring the {object}",))}},
            "says 'bring the mug' for the goal",
        ),
        ((Goal("mug", "handle", color="blue"), Goal("mug", "brim", color="blue")), {}, None),
        ((Goal("mug", color="blue"), Goal("mug", color="red"), Goal("banana")), {}, None),
    ],
    ids=[
        "told apart",
        "a colour",
        "a part",
        "held-out words",
        "the same in two ways",
        "unpainted beside painted",
        "a colour that is not said",
        "a colour and a part that are said",
        "a colour that is said in demonstrations alone",
        "one colour",
        "colours that are said",
    ],
)
def test_no_sentence_means_two_goals(goals: tuple[Goal, ...], settings: dict[str, Any], sentence: str | None) -> None:
    task = row(*goals, **settings)
    if sentence is None:
        task.check()
        return
    with pytest.raises(InputError, match=re.escape(sentence)) as error:
        GraspEnv(task, camera="overhead")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("held_out", ["take the {object}", "take the mug", "grasp the mug and nothing else"])
def test_what_is_held_out_of_demonstrations_is_not_said_in_them(held_out: str) -> None:
    """By the same grammar or by another's, in the same slots or spelt out."""
    grammar = Grammar(("{verb} the {object}",), (held_out,), verbs=("take",))
    task = row(Goal("mug", kind="mine"), Goal("mug"), Goal("fork"), grammars={"mine": grammar})
    with pytest.raises(InputError, match=r"'mine' holds '\w+ the mug.*' out of demonstrations, but has it among"):
        task.check()
    other = replace(grammar, held_out=("fetch the {object}",))
    row(Goal("mug", kind="mine"), Goal("mug"), Goal("fork"), grammars={"mine": other}).check()
