import re

import pytest

from tasks import TASKS, find_task
from tasks.instructions import CHARSET, GRAMMARS, LONGEST, phrasings, render
from tasks.task import Goal, Task

BY_PART = TASKS["pick-by-part"]
SEEN, UNSEEN = phrasings("by part", "seen"), phrasings("by part", "unseen")


def test_there_are_23_goals_of_10_objects():
    assert len(BY_PART.goals) == len(set(BY_PART.goals)) == 23
    assert len(BY_PART.pool) == 10


def test_there_are_20_phrasings_and_at_least_8_held_out():
    assert len(SEEN) == 20
    assert len(UNSEEN) >= 8


def test_no_sentence_says_two_things_and_none_is_both_seen_and_unseen():
    sentences = [render(goal, phrasing) for goal in BY_PART.goals for phrasing in SEEN + UNSEEN]
    assert len(set(sentences)) == len(sentences)


def test_unseen_phrasings_use_no_verb_of_the_seen_ones():
    for verb in GRAMMARS["by part"].verbs:
        assert not any(re.search(rf"\b{verb}\b", phrasing) for phrasing in UNSEEN), verb


@pytest.mark.parametrize("goal", BY_PART.goals, ids=str)
def test_every_sentence_names_object_and_part_in_plain_english(goal):
    for phrasing in SEEN + UNSEEN:
        sentence = render(goal, phrasing)
        assert goal.object.replace("-", " ") in sentence
        assert re.search(rf"\b{goal.part}\b", sentence)
        assert "-" not in sentence
        assert "{" not in sentence
        assert set(sentence) <= set(CHARSET)
        assert len(sentence) <= LONGEST


def test_scissors_are_several():
    assert render(Goal("scissors", "handle"), SEEN[0]) == "pick up the scissors by their handle"
    assert render(Goal("mug", "handle"), SEEN[0]) == "pick up the mug by its handle"
    assert not any("scissors's" in render(Goal("scissors", "handle"), phrasing) for phrasing in UNSEEN)


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(ValueError, match="pick-by-part"):
        find_task("pick-by-prat")
    with pytest.raises(ValueError, match="by part"):
        phrasings("by smell")
    with pytest.raises(ValueError, match="seen"):
        phrasings("by part", "heard")  # ty: ignore[invalid-argument-type]


def test_a_task_needs_enough_objects_to_fill_a_scene():
    with pytest.raises(ValueError, match="name 1"):
        Task("pick-one", "equigrasp/PickOne-v0", (Goal("mug"),), "by part")
