"""Was it the right thing, by the right part? From contacts and heights, after the hand has lifted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from tasks.goal import Goal

Reason = Literal["success", "nothing lifted", "wrong object", "several lifted", "wrong part"]

RISE = 0.03
"""An object is lifted when its centre of mass is higher by this many metres than before."""


@dataclass(frozen=True)
class Outcome:
    """What came of one attempt.

    Attributes:
        lifted: names of the objects that were lifted: their centre of mass rose by more than RISE, a finger
            touches them, and they do not touch the table.
        grasped: whether anything was lifted.
        correct_object: whether the goal's object was lifted, and nothing else.
        correct_part: whether, besides, at least half of its contact points at closing lay on the goal's part;
            the same as `correct_object` for a goal without a part.
        part: the part of the lifted object that most contact points lay on, of equals the goal's; of the goal's
            object where not exactly one object was lifted; None where there were no contacts.
        reason: what went wrong, in one of a few fixed words.
    """

    lifted: tuple[str, ...]
    grasped: bool
    correct_object: bool
    correct_part: bool
    part: str | None
    reason: Reason

    @property
    def success(self) -> bool:
        """Whether the instruction was followed."""
        return self.correct_part

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for `info`."""
        return asdict(self)


def judge(goal: Goal, lifted: Sequence[str], touched: Mapping[str, Sequence[str | None]]) -> Outcome:
    """The outcome of an attempt.

    Args:
        goal: what was asked for.
        lifted: names of the objects that were lifted.
        touched: for each object by name, the part at each of its contact points with a finger at closing;
            None for a point that is on no part.
    """
    correct_object = tuple(lifted) == (goal.name,)
    on_goal = list(touched.get(goal.name, ()))
    if goal.part is None:
        correct_part = correct_object
    else:
        correct_part = correct_object and 2 * on_goal.count(goal.part) >= max(len(on_goal), 1)
    reason: Reason
    if correct_part:
        reason = "success"
    elif not lifted:
        reason = "nothing lifted"
    elif len(lifted) > 1:
        reason = "several lifted"
    elif not correct_object:
        reason = "wrong object"
    else:
        reason = "wrong part"
    held = lifted[0] if len(lifted) == 1 else goal.name
    parts = Counter(part for part in touched.get(held, ()) if part is not None)
    # of two parts that were touched equally often, the goal's: half of the contacts is enough to be right
    most = sorted(parts, key=lambda part: (-parts[part], part != goal.part))
    return Outcome(
        lifted=tuple(lifted),
        grasped=bool(lifted),
        correct_object=correct_object,
        correct_part=correct_part,
        part=most[0] if most else None,
        reason=reason,
    )
