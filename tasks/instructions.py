"""How one says what one wants: small grammars of verbs and frames, and phrasings kept out of training.

A phrasing is a sentence with slots for what the goal names: "{verb} the {object} by {its} {part}". Verbs times
frames give the 20 phrasings that demonstrations use; the unseen ones share neither verb nor frame with them,
and only test whether a policy understood more than the words that it was shown.
"""

from __future__ import annotations

import string
from dataclasses import dataclass
from typing import Literal

from equigrasp.errors import InputError
from tasks.goal import Goal

PhrasingSet = Literal["seen", "unseen"]

_PLURAL = frozenset({"scissors"})

PUNCTUATION = ",.:;?!'-"
CHARSET = string.ascii_letters + string.digits + " " + PUNCTUATION
"""Every character that an instruction may hold."""

LONGEST = 128
"""No instruction has more characters than this."""

VERBS = ("pick up", "grasp", "grab", "lift", "take hold of")


@dataclass(frozen=True)
class Grammar:
    """The phrasings of one kind of goal.

    Attributes:
        frames: sentences with slots `{verb}`, those of `names`, and, as the object is one or several, `{it}` (it,
            them), `{its}` (its, their), `{is_}` (is, are) and `{owner}` (mug's, scissors').
        held_out: whole sentences, of other words, never used in training.
        names: the slots that say which goal is meant, of "object", "color", "part" and "mark" (what follows
            the first hyphen of the object's name: the letter of "bottle-A").
        verbs: put into the frames' `{verb}`.
    """

    frames: tuple[str, ...]
    held_out: tuple[str, ...]
    names: tuple[str, ...] = ("object",)
    verbs: tuple[str, ...] = VERBS

    @property
    def seen(self) -> tuple[str, ...]:
        """Every frame with every verb."""
        return tuple(frame.replace("{verb}", verb, 1) for frame in self.frames for verb in self.verbs)

    def phrasings(self, which: PhrasingSet = "seen") -> tuple[str, ...]:
        """The sentences, still with slots.

        Raises:
            ValueError: if there is no such set of phrasings.
        """
        if which not in ("seen", "unseen"):
            raise ValueError(f"phrasings are 'seen' or 'unseen', but this is {which!r}")
        return self.seen if which == "seen" else self.held_out

    def words(self, goal: Goal) -> tuple[str, ...]:
        """The words in a sentence that say which goal is meant, in the order of `names`.

        Raises:
            InputError: if the goal has not all of them.
        """
        said = _said(goal)
        for name in self.names:
            if not said.get(name):
                raise _unsaid(goal, name, f"the grammar {goal.kind!r}")
        return tuple(said[name] for name in self.names)


GRAMMARS: dict[str, Grammar] = {
    "object": Grammar(
        frames=(
            "{verb} the {object}",
            "{verb} the {object} from the table",
            "please {verb} the {object}",
            "{verb} the {object} and nothing else",
        ),
        held_out=(
            "bring me the {object}",
            "could you fetch the {object} for me?",
            "I would like to have the {object}",
            "get the {object} off the table",
            "raise the {object} into the air",
            "seize the {object}, leave the others where they are",
            "look for the {object} and hand {it} to me",
            "what I need is the {object}",
            "close the gripper on the {object}",
            "hoist the {object}",
        ),
    ),
    "colored object": Grammar(
        names=("color", "object"),
        frames=(
            "{verb} the {color} {object}",
            "{verb} the {color} {object} from the table",
            "please {verb} the {color} {object}",
            "{verb} the {object} that {is_} {color}",
        ),
        held_out=(
            "bring me the {color} {object}",
            "could you fetch the {object} painted {color}?",
            "I would like to have the {color} {object}",
            "get the {color} {object} off the table",
            "raise the {object} of {color} color into the air",
            "seize the {object}, the {color} one",
            "look for the {color} {object} and hand {it} to me",
            "what I need is the {object} in {color}",
            "close the gripper on the {color} {object}",
            "hoist the {color} {object}",
        ),
    ),
    "caption": Grammar(
        names=("mark",),
        frames=(
            "{verb} the bottle captioned {mark}",
            "{verb} bottle {mark}",
            "{verb} the bottle with {mark} on its cap",
            "{verb} the bottle that says {mark}",
        ),
        held_out=(
            "bring me the bottle marked {mark}",
            "could you fetch the one labeled {mark}?",
            "I would like to have bottle {mark}",
            "get the bottle whose cap reads {mark}",
            "raise the bottle bearing the letter {mark}",
            "seize the {mark} bottle, leave the others where they are",
            "look for the letter {mark} and hand that bottle to me",
            "what I need is the bottle with the caption {mark}",
            "close the gripper on bottle {mark}",
            "hoist the bottle showing {mark} on top",
        ),
    ),
    "logo": Grammar(
        names=("mark",),
        frames=(
            "{verb} the block with the {mark} logo",
            "{verb} the {mark} block",
            "{verb} the block that shows the {mark}",
            "{verb} the block with the {mark} on top",
        ),
        held_out=(
            "bring me the block marked with the {mark}",
            "could you fetch the cube that has the {mark} printed on it?",
            "I would like to have the {mark} cube",
            "get the block whose logo is the {mark}",
            "raise the block bearing the {mark}",
            "seize the {mark} one, leave the others where they are",
            "look for the {mark} and hand that block to me",
            "what I need is the block labeled with the {mark}",
            "close the gripper on the {mark} block",
            "hoist the block carrying the {mark}",
        ),
    ),
    "by part": Grammar(
        names=("object", "part"),
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
"""The grammars by the kind of goal that they speak of (`Goal.kind`)."""


def render(goal: Goal, phrasing: str) -> str:
    """The instruction: a phrasing with the goal's words in its slots.

    Raises:
        InputError: if the phrasing has a slot that nothing fills.
    """
    plural = goal.object in _PLURAL
    said = _said(goal)
    name = said["object"]
    # an empty slot is no slot, or one would hear "pick up the mug by its "
    filled = {slot: word for slot, word in said.items() if word}
    try:
        return phrasing.format(
            it="them" if plural else "it",
            its="their" if plural else "its",
            is_="are" if plural else "is",
            owner=f"{name}'" if plural else f"{name}'s",
            **filled,
        )
    except KeyError as slot:
        raise _unsaid(goal, slot.args[0], f"the phrasing {phrasing!r}") from None
    except (ValueError, IndexError, AttributeError, TypeError) as error:
        raise InputError(f"the phrasing {phrasing!r} is no sentence with slots like {{object}}: {error}") from None


def _unsaid(goal: Goal, slot: str, what: str) -> InputError:
    """That what was said has a slot which the goal leaves empty, or any goal."""
    if slot not in _said(goal):
        return InputError(f"{what} has a slot {slot!r} that no goal fills; there are {', '.join(_said(goal))}")
    mark = " (what follows the first hyphen of its object's name)" if slot == "mark" else ""
    return InputError(
        f"{what} says a goal's {slot}{mark}, but the goal {str(goal)!r} has none; give it one, or a kind other than "
        f"{goal.kind!r}"
    )


def _said(goal: Goal) -> dict[str, str]:
    return {
        "object": goal.object.replace("-", " "),
        "color": goal.color or "",
        "part": goal.part or "",
        "mark": goal.object.partition("-")[2].replace("-", " "),
    }
