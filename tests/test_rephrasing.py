"""Recombined sentences ask for the same goal in words that the demonstrators used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from equigrasp.augmentation import Augmentation
from equigrasp.augmentation.rephrasing import frame, rephrased
from equigrasp.grasp import Demonstration
from tasks import TASKS
from tasks.instructions import GRAMMARS, render

TASK = TASKS["pick-by-part"]


def said(example: Demonstration, kind: str, words: tuple[str, ...], instruction: str) -> Demonstration:
    return replace(example, kind=kind, words=words, instruction=instruction)


def test_every_goal_is_asked_for_in_every_frame(demonstrations: list[Demonstration]) -> None:
    """What is said is what the suite itself would say, but for the pronoun of the scissors."""
    seen = GRAMMARS["by part"].seen
    for each in demonstrations:
        goal = TASK.goals[each.goal]
        own = {render(goal, phrasing).replace(" their ", " its ") for phrasing in seen}
        sentences = rephrased(each, demonstrations)
        assert sentences[0] == each.instruction
        assert {sentence.replace(" their ", " its ") for sentence in sentences} <= own
        assert len(sentences) >= 10


def test_no_sentence_asks_for_two_goals(demonstrations: list[Demonstration]) -> None:
    sentences = [sentence for each in demonstrations for sentence in rephrased(each, demonstrations)]
    assert len(sentences) == len(set(sentences))


@pytest.mark.parametrize(
    ("words", "instruction"),
    [
        (("mug", "handle"), "take it by the handle"),
        (("mug", "handle"), "pick up the mug"),
        (("mug", "head"), "pick up the mug by the head, the head of the mug"),
        (("fork", "head"), "pick up the pitchfork by its head"),
    ],
)
def test_a_sentence_that_does_not_name_its_goal_once_lends_no_frame(
    demonstrations: list[Demonstration], words: tuple[str, ...], instruction: str
) -> None:
    odd = said(demonstrations[0], "by part", words, instruction)
    assert frame(odd) is None
    assert rephrased(odd, [odd])[0] == instruction
    assert rephrased(demonstrations[1], [odd]) == (demonstrations[1].instruction,)


def test_each_kind_of_goal_keeps_its_own_frames(demonstrations: list[Demonstration]) -> None:
    whole = said(demonstrations[0], "object", ("medium clamp",), "fetch the medium clamp")
    part = said(demonstrations[1], "by part", ("mug", "handle"), "take the mug by the handle")
    other = said(demonstrations[2], "object", ("lion",), "bring me the lion")
    bottle = said(demonstrations[3], "caption", ("A",), "A bottle, the one captioned a")
    colored = said(demonstrations[4], "colored object", ("blue", "mug"), "lift the mug that is blue")
    also = said(demonstrations[5], "colored object", ("red", "L block"), "grab the red L block")
    everything = [whole, part, other, bottle, colored, also]
    assert rephrased(whole, everything) == ("fetch the medium clamp", "bring me the medium clamp")
    assert rephrased(part, everything) == ("take the mug by the handle",)
    assert rephrased(bottle, everything) == (bottle.instruction,)
    assert rephrased(also, everything) == ("grab the red L block", "lift the L block that is red")


def test_examples_say_what_was_recombined_and_nothing_else(demonstrations: list[Demonstration]) -> None:
    rng = np.random.default_rng(0)
    plain, recombined = Augmentation(demonstrations, 0.0), Augmentation(demonstrations, 1.0)
    own = {each.instruction for each in demonstrations}
    assert set(plain.instructions) == own
    assert {plain.sample(rng).instruction for _ in range(30)} <= own
    drawn = {recombined.sample(rng).instruction for _ in range(30)}
    assert drawn <= set(recombined.instructions)
    assert len(drawn - own) > 15
