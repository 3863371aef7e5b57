"""How one says what one wants: small grammars of verbs and frames, and phrasings kept out of training.

A phrasing is a sentence with slots for the object and the part: "{verb} the {object} by {its} {part}".
Verbs times frames give the 20 phrasings that demonstrations use; the unseen ones share neither verb nor frame
with them, and only test whether a policy understood more than the words that it was shown.
"""

from __future__ import annotations

import string
from dataclasses import dataclass
from typing import Literal

from tasks.task import Goal

PhrasingSet = Literal["seen", "unseen"]

_PLURAL = frozenset({"scissors"})

CHARSET = string.ascii_letters + string.digits + " ,.:;?!'-"
"""Every character that an instruction may hold."""

LONGEST = 128
"""No instruction has more characters than this."""


@dataclass(frozen=True)
class Grammar:
    """The phrasings of one kind of task.

    Attributes:
        verbs: put into the frames' `{verb}`.
        frames: sentences with slots `{verb}`, `{object}`, `{part}`, and, as the object is one or several,
            `{it}` (it, them), `{its}` (its, their) and `{owner}` (mug's, scissors').
        held_out: whole sentences, of other words, never used in training.
    """

    verbs: tuple[str, ...]
    frames: tuple[str, ...]
    held_out: tuple[str, ...]

    @property
    def seen(self) -> tuple[str, ...]:
        """Every frame with every verb."""
        return tuple(frame.replace("{verb}", verb, 1) for frame in self.frames for verb in self.verbs)


GRAMMARS: dict[str, Grammar] = {
    "by part": Grammar(
        verbs=("pick up", "grasp", "grab", "lift", "take hold of"),
        frames=(
            "{verb} the {object} by {its} {part}",
            "{verb} the {object} by the {part}",
            "{verb} the {part} of the {object}",
            "{verb} the {object}, using {its} {part}",
        ),
        held_out=(
            "raise the {object} with the {part} between your fingers",
            "please fetch me the {object} and keep your grip on {its} {part}",
            "get the {object}; the {part} is where to hold {it}",
            "could you seize the {object} around the {part}?",
            "clamp your fingers onto the {part} belonging to the {object}",
            "I would like the {object}, gripped at the {part}",
            "close the gripper on the {owner} {part}",
            "hoist the {object} from {its} {part}",
            "look for the {object} and clasp {it} where {its} {part} is",
            "bring me the {object} while holding {its} {part}",
        ),
    ),
}
"""The grammars by their name in `Task.phrasing`."""


def phrasings(kind: str, which: PhrasingSet = "seen") -> tuple[str, ...]:
    """The sentences, still with slots for object and part, of a grammar.

    Raises:
        ValueError: if there is no such grammar, or no such set of phrasings.
    """
    if kind not in GRAMMARS:
        raise ValueError(f"there is no grammar {kind!r}; there are {sorted(GRAMMARS)}")
    if which not in ("seen", "unseen"):
        raise ValueError(f"phrasings are 'seen' or 'unseen', but this is {which!r}")
    return GRAMMARS[kind].seen if which == "seen" else GRAMMARS[kind].held_out


def render(goal: Goal, phrasing: str) -> str:
    """The instruction: a phrasing with the goal's words in its slots."""
    plural = goal.object in _PLURAL
    name = goal.object.replace("-", " ")
    return phrasing.format(
        object=name,
        part=goal.part,
        it="them" if plural else "it",
        its="their" if plural else "its",
        owner=f"{name}'" if plural else f"{name}'s",
    )
