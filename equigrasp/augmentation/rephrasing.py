"""Recombination of sentences: every demonstrated goal, asked for in the words of every demonstration of its kind.

With one demonstration each goal has been asked for in one sentence, and a policy takes the accident of its wording
for part of the meaning: of its failures on new scenes nearly all vanish when they are asked for in the sentence
that was demonstrated. The demonstrator knows which words say what is meant. With these words exchanged, "grab the
lion by its head" and "lift the handle of the mug" also say "grab the mug by its handle".
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from equigrasp.grasp import Demonstration


def frame(demonstration: Demonstration) -> str | None:
    """The demonstration's sentence with the i-th of its words replaced by the character of code i.

    None where a word is not in it exactly once. (No instruction holds these characters.)
    """
    sentence = demonstration.instruction
    for slot, word in enumerate(demonstration.words):
        sentence, count = re.subn(rf"\b{re.escape(word)}\b", chr(slot), sentence)
        if count != 1:
            return None
    return sentence


def rephrased(demonstration: Demonstration, demonstrations: Sequence[Demonstration]) -> tuple[str, ...]:
    """Every sentence that asks for this demonstration's goal in the words of one of the demonstrations.

    Frames come from demonstrations of the same kind of goal, with as many words. Pronouns are kept, so that
    "their handle" may be said of a single thing.

    Args:
        demonstration: whose goal is asked for; its own sentence comes first.
        demonstrations: whose words are used.

    Returns:
        Different sentences, in the order of the demonstrations.
    """
    alike = [
        each
        for each in demonstrations
        if each.kind == demonstration.kind and len(each.words) == len(demonstration.words) > 0
    ]
    sentences = []
    for found in (frame(each) for each in alike):
        if found is not None:
            for slot, word in enumerate(demonstration.words):
                found = found.replace(chr(slot), word)
            sentences.append(found)
    return tuple(dict.fromkeys([demonstration.instruction, *sentences]))
