"""Recombination of sentences: every demonstrated goal, asked for in the words of every demonstration.

With one demonstration each goal has been asked for in one sentence, and a policy takes the accident of its wording
for part of the meaning: of its failures on new scenes nearly all vanish when they are asked for in the sentence
that was demonstrated. The demonstrator knows which words name the object and its part. With these words
exchanged, "grab the lion by its head" and "lift the handle of the mug" also say "grab the mug by its handle".
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from equigrasp.grasp import Demonstration

OBJECT, PART = "\0", "\1"
"""What stands for the two names in a sentence's frame; no instruction holds these characters."""


def frame(demonstration: Demonstration) -> str | None:
    """The demonstration's sentence without the names of its object and part, or None where it does not name them."""
    sentence = demonstration.instruction
    for name, slot in ((demonstration.target, OBJECT), (demonstration.part, PART)):
        if name is not None:
            sentence, count = re.subn(rf"\b{re.escape(spoken(name))}\b", slot, sentence)
            if count != 1:
                return None
    return sentence


def spoken(name: str) -> str:
    """A name as a sentence has it: "medium-clamp" is said "medium clamp"."""
    return name.replace("-", " ")


def rephrased(demonstration: Demonstration, demonstrations: Sequence[Demonstration]) -> tuple[str, ...]:
    """Every sentence that asks for this demonstration's goal in the words of one of the demonstrations.

    Frames come from demonstrations of the same kind: of goals with a part, if this one has a part. Pronouns are
    kept, so that "their handle" may be said of a single thing.

    Args:
        demonstration: whose goal is asked for; its own sentence comes first.
        demonstrations: whose words are used.

    Returns:
        Different sentences, in the order of the demonstrations.
    """
    with_part = demonstration.part is not None
    frames = [frame(each) for each in demonstrations if (each.part is not None) == with_part]
    sentences = [
        each.replace(OBJECT, spoken(demonstration.target)).replace(PART, spoken(demonstration.part or ""))
        for each in frames
        if each is not None
    ]
    return tuple(dict.fromkeys([demonstration.instruction, *sentences]))
